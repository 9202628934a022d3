from __future__ import annotations

import fcntl
import json
import os
import re
import sys
from pathlib import Path

import pytest
from typer import Typer
from typer.testing import CliRunner

from socialbot.bridge import environment, ros_checks
from socialbot.bridge.ros_checks import Finding, Trial, cause
from socialbot.cli import doctor as doctor_command
from socialbot.cli import doctor as doctor_module
from socialbot.core.errors import NodeError
from socialbot.vision import detectors as nanodet_module

ROOT = Path(__file__).parents[2]

app = Typer()
app.command()(doctor_command.doctor)

FINDINGS = (
    Finding("Python", "ok", "3.11"),
    Finding("cameras", "warning", "none " + "of the devices can be opened " * 5, "look [here] " + "for more " * 12),
    Finding("ROS 2", "error", "not installed", "pip install socialbot"),
)


@pytest.fixture
def wheels(monkeypatch) -> None:
    monkeypatch.setattr(environment, "wheels_installed", lambda: True)


class TestCommand:
    def run(self, monkeypatch, findings, *arguments: str):
        monkeypatch.setattr(doctor_command, "examine", lambda **how: iter(findings))
        return CliRunner().invoke(app, arguments, env={"COLUMNS": "80", "LINES": None}, catch_exceptions=False)

    def test_exit_code_is_5_after_an_error(self, monkeypatch):
        assert self.run(monkeypatch, FINDINGS).exit_code == 5
        assert self.run(monkeypatch, FINDINGS[:2]).exit_code == 0

    def test_fits_in_80_columns(self, monkeypatch):
        lines = self.run(monkeypatch, FINDINGS).output.splitlines()
        assert max(map(len, lines)) <= 80
        assert all(line == line.rstrip() for line in lines)
        assert any(re.match(r" +remedy: look \[here\]", line) for line in lines)
        assert lines[-1] == "1 ok, 1 warning, 1 error"

    def test_json_holds_everything(self, monkeypatch):
        result = self.run(monkeypatch, FINDINGS, "--json")
        report = json.loads(result.output)
        assert (report["schema"], result.exit_code) == ("socialbot/doctor", 5)
        assert [Finding(**each) for each in report["findings"]] == list(FINDINGS)


class TestExamine:
    def test_failing_check_is_a_finding(self, monkeypatch):
        def broken_thing() -> Finding:
            raise RuntimeError("no such luck")

        monkeypatch.setattr(doctor_module, "FIRST_CHECKS", (broken_thing,))
        first = next(iter(doctor_module.examine(quick=True)))
        assert (first.name, first.state) == ("broken thing", "error")
        assert "no such luck" in first.text

    def test_nothing_installed_gives_findings_and_no_traceback(self, monkeypatch):
        for module in ("rclpy", "cv2", "espeakng_loader", "miniaudio"):
            monkeypatch.setitem(sys.modules, module, None)
        found = {finding.name: finding for finding in doctor_module.examine()}
        assert found["ROS 2"].state == found["OpenCV"].state == "error"
        assert found["speech"].state == "warning"
        assert all(found[name].remedy for name in ("ROS 2", "OpenCV", "speech"))
        assert "DDS round trip" not in found

    @pytest.mark.ros
    def test_this_installation_has_no_errors(self):
        found = list(doctor_module.examine(quick=True))
        assert [finding for finding in found if finding.state == "error"] == []
        assert all(finding.remedy for finding in found if finding.state != "ok")

    @pytest.mark.ros
    def test_round_trip_reaches_another_process(self):
        finding = ros_checks.round_trip()
        assert finding is not None
        assert finding.state in ("ok", "warning")
        assert re.match(r"\d+ of 30 pictures", finding.text)


class TestRosChecks:
    def test_versions_match_pyproject(self):
        required = (ROOT / "pyproject.toml").read_text().partition("[project.optional-dependencies]")[0]
        asked = re.findall(r'"(ros-jazzy-[\w-]+)==([\d.]+)', required)
        assert dict(asked) == dict(ros_checks.WHEELS)

    @pytest.mark.usefixtures("wheels")
    @pytest.mark.parametrize(
        ("variables", "state"),
        [
            ({}, "error"),
            ({ros_checks.GUARD: "1"}, "error"),
            ({ros_checks.GUARD: "1", "LD_LIBRARY_PATH": "{prefix}/lib"}, "ok"),
            ({ros_checks.GUARD: "1", "LD_LIBRARY_PATH": "/usr/lib:{prefix}/lib"}, "ok"),
            ({ros_checks.GUARD: "1", "LD_LIBRARY_PATH": "{prefix}/lib:/elsewhere/ros_rcl.libs"}, "warning"),
        ],
    )
    def test_library_path_of_the_wheels(self, tmp_path, variables, state):
        filled = {name: value.format(prefix=tmp_path) for name, value in variables.items()}
        finding = ros_checks.library_path(filled, tmp_path)
        assert finding is not None
        assert (finding.state, bool(finding.remedy)) == (state, state != "ok")

    @pytest.mark.parametrize(
        ("opened", "named"), [((), ""), (("lo",), ""), (("all",), "all"), (("eth0", "lo"), "eth0")]
    )
    def test_networks_that_reach_the_loopback_address(self, tmp_path, opened, named):
        for name in ("all", "default", "eth0", "lo"):
            (tmp_path / name).mkdir()
            (tmp_path / name / "route_localnet").write_text(f"{int(name in opened)}\n")
        finding = ros_checks.loopback(tmp_path)
        assert (finding is None) == (not named)
        if finding is not None:
            assert finding.state == "warning"
            assert f"route_localnet is set for {named}" in finding.text
            assert f"sysctl -w net.ipv4.conf.{named}.route_localnet=0" in finding.remedy

    def test_names_missing_message_packages(self, monkeypatch):
        monkeypatch.setattr(ros_checks.importlib.util, "find_spec", lambda name: None if name == "hri_msgs" else name)
        finding = ros_checks.viewers()
        assert (finding.state, finding.remedy) == ("ok", "")
        assert finding.text == "publishes visualization_msgs, tf2_msgs, vision_msgs; not installed: hri_msgs"

    @pytest.mark.usefixtures("wheels")
    def test_second_ros_is_a_warning(self):
        finding = ros_checks.other_ros({"ROS_DISTRO": "humble", "AMENT_PREFIX_PATH": "/opt/ros/humble"})
        assert finding is not None
        assert finding.state == "warning"
        assert "humble" in finding.text

    @pytest.mark.usefixtures("wheels")
    @pytest.mark.parametrize(
        ("variables", "state"),
        [
            ({}, "ok"),
            ({"ROS_DOMAIN_ID": "42"}, "ok"),
            ({"ROS_DOMAIN_ID": "forty"}, "error"),
            ({"ROS_DOMAIN_ID": "120"}, "warning"),
            ({"ROS_LOCALHOST_ONLY": "1"}, "warning"),
            ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "error"),
            ({"ROS_SECURITY_ENABLE": "true"}, "error"),
        ],
    )
    def test_settings(self, variables, state):
        assert ros_checks.settings(variables).state == state

    @pytest.mark.parametrize(
        ("text", "state"),
        [
            (environment.PROFILE.read_text(), "ok"),
            (environment.PROFILE.read_text().replace("33554432", "524288"), "warning"),
            ("<profiles/>", "warning"),
            ("<profiles>", "error"),
            (
                "<p><transport_descriptor><type>SHM</type><segment_size>big</segment_size></transport_descriptor></p>",
                "error",
            ),
            (None, "error"),
        ],
    )
    def test_other_profiles(self, tmp_path, text, state):
        path = tmp_path / "profile.xml"
        if text is not None:
            path.write_text(text)
        finding = ros_checks.profile({environment.PROFILE_VARIABLE: str(path)})
        assert (finding.state, bool(finding.remedy)) == (state, state != "ok")

    def test_a_pipe_is_no_profile(self, tmp_path):
        os.mkfifo(path := tmp_path / "pipe.xml")
        assert ros_checks.profile({environment.PROFILE_VARIABLE: str(path)}).state == "error"

    def test_own_profile_is_ok(self):
        assert ros_checks.profile({}).state == "ok"
        assert ros_checks.profile({environment.PROFILE_VARIABLE: ""}).state == "ok"
        size = ros_checks.segment_size(environment.PROFILE)
        assert size is not None
        assert size >= ros_checks.SEGMENT_BYTES

    def test_finds_shared_memory_of_ended_processes(self, tmp_path):
        for name in ("0123456789abcdef", "fedcba9876543210", "port7411"):
            (tmp_path / f"fastrtps_{name}").write_bytes(bytes(5000))
            (tmp_path / f"fastrtps_{name}_el").touch()
            os.utime(tmp_path / f"fastrtps_{name}_el", (0, 0))
        (tmp_path / "fastrtps_notes_el").touch()
        with (tmp_path / "fastrtps_fedcba9876543210_el").open("rb") as alive:
            fcntl.flock(alive, fcntl.LOCK_EX)
            finding = ros_checks.stale_memory(tmp_path)
        assert finding is not None
        assert finding.state == "warning"
        assert finding.text.startswith("1 segment of ended")

    def test_shared_memory_must_exist_and_be_large(self, tmp_path, monkeypatch):
        missing = ros_checks.shared_memory(tmp_path / "none")
        assert missing is not None
        assert missing.state == "warning"
        monkeypatch.setattr(ros_checks, "SHARED_MEMORY_BYTES", 10**18)
        small = ros_checks.shared_memory(tmp_path)
        assert small is not None
        assert "--shm-size" in small.remedy

    def test_small_receive_buffer_is_a_warning(self, tmp_path):
        path = tmp_path / "rmem_max"
        states = []
        for size in (212992, 4194304):
            path.write_text(f"{size}\n")
            finding = ros_checks.receive_buffer(path)
            assert finding is not None
            states.append(finding.state)
        assert states == ["warning", "ok"]

    @pytest.mark.ros
    @pytest.mark.parametrize(("received", "state"), [(30, "ok"), (29, "ok"), (12, "warning"), (0, "error")])
    def test_lost_images(self, monkeypatch, received, state):
        monkeypatch.setattr(ros_checks, "try_round_trip", lambda: Trial(30, received))
        finding = ros_checks.round_trip()
        assert finding is not None
        assert (finding.state, bool(finding.remedy)) == (state, state != "ok")

    @pytest.mark.parametrize(("security", "is_own"), [("true", True), ("True", True), ("false", False), ("", False)])
    def test_round_trip_with_security_is_in_the_domain_of_its_enclave(self, monkeypatch, security, is_own):
        """In another domain, DDS refuses the enclave. DDS with security is not here, so no image is sent."""
        domains: list[str] = []
        monkeypatch.setenv("ROS_SECURITY_ENABLE", security)
        monkeypatch.setenv("ROS_DOMAIN_ID", "7")
        monkeypatch.setattr(ros_checks, "_count", lambda variables, part: domains.append(variables["ROS_DOMAIN_ID"]))
        ros_checks.try_round_trip()
        assert [domain == "7" for domain in domains] == [is_own, is_own]

    @pytest.mark.ros
    def test_failing_round_trip(self, monkeypatch):
        def fail() -> Trial:
            raise NodeError("cannot send: no luck")

        monkeypatch.setattr(ros_checks, "try_round_trip", fail)
        finding = ros_checks.round_trip()
        assert finding is not None
        assert (finding.state, finding.text) == ("error", "cannot send: no luck")

    @pytest.mark.parametrize(
        ("complaint", "code", "line"),
        [
            (
                "Traceback\n  File\nImportError: librcl.so\nDuring handling\nmore.Error: x\nhelp",
                1,
                "ImportError: librcl.so",
            ),
            ("first\nlast\n", 1, "last"),
            ("", 3, "exit code 3"),
            ("", -11, "signal 11"),
        ],
    )
    def test_cause_of_a_failure(self, complaint, code, line):
        assert cause(complaint, code) == line


class TestOtherChecks:
    def test_folder_of_runs(self, tmp_path, monkeypatch):
        assert doctor_module.runs_folder(tmp_path / "runs").state == "ok"
        (tmp_path / "file").touch()
        assert doctor_module.runs_folder(tmp_path / "file" / "runs").state == "error"
        monkeypatch.setattr(doctor_module, "MIN_FREE_BYTES", 10**18)
        assert doctor_module.runs_folder(tmp_path / "runs").state == "warning"

    def test_camera_that_cannot_be_opened(self, tmp_path, monkeypatch):
        (tmp_path / "video0").touch()
        monkeypatch.setattr(doctor_module, "_picture_size", lambda device: None)
        finding = doctor_module.cameras(tmp_path)
        assert finding is not None
        assert finding.state == "warning"
        monkeypatch.setattr(doctor_module, "_picture_size", lambda device: (640, 480))
        finding = doctor_module.cameras(tmp_path)
        assert finding == Finding("cameras", "ok", "video0 (640x480)")

    def test_unsupported_python(self, monkeypatch):
        monkeypatch.setattr(doctor_module, "OLDEST", (3, 99))
        assert doctor_module.python().state == "error"

    def test_opencv_without_hog(self, monkeypatch):
        cv2 = pytest.importorskip("cv2")
        monkeypatch.setattr(cv2, "__version__", "5.0.0")
        assert doctor_module.opencv().state == "error"

    def test_changed_network_file(self, monkeypatch):
        assert doctor_module.network().state == "ok"
        monkeypatch.setattr(nanodet_module, "SHA256", "0" * 64)
        finding = doctor_module.network()
        assert finding.state == "error"
        assert "sha256" in finding.text
        assert "detector=hog" in finding.remedy


def test_pose_of_the_camera_is_shown_with_its_source(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def shown(**parameters: object) -> Finding:
        lines = "".join(f"\n      {name}: {value}" for name, value in parameters.items())
        inputs = "inputs: [/camera/image_color, /camera/camera_info]"
        node = f"  eyes:\n    type: person_detector\n    parameters:{lines or ' {}'}"
        text = f"name: room\n{inputs}\nnodes:\n{node}\n"
        Path("room.yaml").write_text(text)
        finding = doctor_module.camera_pose("room.yaml")
        assert finding is not None
        return finding

    assumed = shown()
    assert (assumed.state, "assumed" in assumed.text) == ("warning", True)
    assert "set eyes.camera_file=camera.json" in assumed.remedy
    assert shown(mount_height_m=1.2, pitch_rad=0.1).text == "room.yaml: 1.20 m high, 0.100 rad down (given)"
    pose = {"height_m": 1.4, "pitch_rad": 0.05, "height_std_m": 0.1, "pitch_std_rad": 0.02, "people": 7}
    Path("camera.json").write_text(json.dumps(pose))
    known = shown(camera_file="camera.json")
    assert known == Finding("camera pose", "ok", "room.yaml: 1.40 +- 0.10 m high, 0.050 +- 0.020 rad down (7 people)")


def test_graph_without_a_person_detector_has_no_camera_pose():
    assert doctor_module.camera_pose("warehouse") is None
