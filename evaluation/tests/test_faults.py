import json

import psutil
import pytest

from evaluation.faults import ROWS, Row, chosen, main, try_all
from evaluation.faults_load import busy_processes
from evaluation.faults_plan import Plan, Skipped
from evaluation.report import Report
from socialbot.core.errors import NodeError, ParameterError
from tests.system.running import eventually


def meets(report, plan):
    report.add("meets_s", "time", 1.0, 2.0)
    return "1 s"


def misses(report, plan):
    report.add("misses_s", "time", 3.0, plan.of(1.0, 2.0))
    return "3 s"


def cannot(report, plan):
    raise Skipped("no right")


def breaks(report, plan):
    raise NodeError("it has ended", where="robot")


@pytest.fixture
def tried(tmp_path):
    report, told = Report("faults", quick=True), []
    rows = {name: Row(f"{__name__}:{name}", f"fault {name}", "within 2 s") for name in ("meets", "misses")}
    rows |= {name: Row(f"{__name__}:{name}", f"fault {name}", "nothing") for name in ("cannot", "breaks")}
    try_all(rows, report, Plan(tmp_path, 51, told.append, quick=True))
    return report, told


def test_a_row_is_met_when_all_of_its_figures_are_and_one_that_breaks_ends_no_other(tried):
    report, told = tried
    table = report.tables["faults"]
    assert [row["met"] for row in table.values()] == [True, False, None, False]
    assert table["fault cannot"]["measured"] == "skipped: no right"
    assert table["fault breaks"]["measured"] == "came to nothing: robot: it has ended"
    assert report.unmet == ["misses_s", "breaks_tried"]
    assert told[0] == "meets: fault meets"
    assert told[3].startswith("misses: 3 s (NOT met, ")


def test_rows_keep_their_order_and_unknown_ones_are_refused():
    assert chosen("") == list(ROWS)
    assert chosen("outage, clear") == ["clear", "outage"]
    with pytest.raises(ParameterError, match="no row 'loss'"):
        chosen("loss")


def test_the_command_writes_the_table_and_ends_with_1_when_something_is_missed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("evaluation.faults.ROWS", {"misses": Row(f"{__name__}:misses", "a fault", "within 1 s")})
    with pytest.raises(SystemExit) as ended:
        main(only="", quick=False, domain=51, json=tmp_path / "figures.json", out=tmp_path)
    assert ended.value.code == 1
    assert json.loads((tmp_path / "figures.json").read_text("utf-8"))["faults"]["a fault"]["met"] is False
    assert "within 1 s" in capsys.readouterr().out


def test_rows_have_records_of_their_own(tmp_path):
    plan = Plan(tmp_path, 51, print)
    assert plan.records("clear").is_dir()
    with pytest.raises(FileExistsError):
        plan.records("clear")


def test_busy_processes_use_the_processor_until_the_end():
    with busy_processes(2) as pids:
        assert eventually(lambda: all(psutil.Process(pid).cpu_times().user > 0.1 for pid in pids))
    assert not [pid for pid in pids if psutil.pid_exists(pid)]
