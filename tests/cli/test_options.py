"""Options that would change nothing are refused by name."""

from __future__ import annotations

import pytest

from tests.system.running import socialbot_here

CASES = {
    "agent shell --load agents:make --name ada": "--name: without effect with --load, whose agent has one",
    "bag import 0 new --image-rate 5": "--image-rate: without effect for a camera",
    "bag import 0 new --sound": "--sound: without effect for a camera",
    "bag import film.mp4 new --image-rate 5": "--image-rate: without effect for a video, which has time stamps",
    "bag play bag --image-topic /camera": "--image-topic: without effect without --graph",
    "bag play bag --pace": "--pace: without effect without --graph",
    "bag record new --graph waldo": "--graph: without effect without --privacy",
    "bag redact bag new --privacy no-images --whole": "--whole: without effect with --privacy no-images",
    "calibrate 0 --image-topic /camera": "--image-topic: without effect for a camera or topic",
    "calibrate bag --seconds 9": "--seconds: without effect for a bag",
    "doctor waldo --quick": "--quick: without effect for a graph",
    "doctor --robot nao --graph waldo": "--graph: without effect for a robot",
    "evaluate bag.mcap --no-speed --threads 1": "--threads: without effect with --no-speed",
    "evaluate bag.mcap --scheduler 127.0.0.1:1 --jobs 2": "--jobs: without effect with --scheduler",
    "evaluate bag.mcap --people visitor": "--people: without effect for bags, which label people only",
    "inspect folder --machine robot": "--machine: without effect for a recorded run",
    "plan d.pddl p.pddl --validate plan --timeout 3": "--timeout: without effect with --validate",
    "replay bag --port 9000": "--port: without effect without --inspect",
    "replay bag --runner ros --cache": "--cache: without effect with --runner ros",
    "replay bag --domain 7": "--domain: without effect without --runner ros",
    "run waldo --port 9000": "--port: without effect without --inspect",
    "status --watch --json": "--json: without effect with --watch",
    "status --watch --wait 3": "--wait: without effect with --watch",
    "sweep bag --set waldo.range_m=3,6 --seed 4": "--seed: without effect with --method grid",
    "sweep bag --set waldo.range_m=3,6 --scheduler 127.0.0.1:1 --jobs 2": "--jobs: without effect with --scheduler",
    "test waldo bag --runner ros --cache": "--cache: without effect with --runner ros",
    "up waldo --foxglove-port 9000": "--foxglove-port: without effect without --foxglove",
    "up waldo --port 9000": "--port: without effect without --inspect",
}


@pytest.mark.parametrize(("command", "told"), CASES.items(), ids=CASES)
def test_an_option_that_would_change_nothing_is_refused(tmp_path, monkeypatch, command, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "bag.mcap").touch()
    (tmp_path / "d.pddl").write_text("(define (domain d) (:predicates (p)))")
    (tmp_path / "p.pddl").write_text("(define (problem p) (:domain d) (:init) (:goal (p)))")
    done = socialbot_here(*command.split())
    assert (done.returncode, told in done.stderr) == (4, True), done.stderr
    assert not (tmp_path / "new").exists()
