"""`eha-bench compare`, `ab`, `history`, `baseline` and the pytest plug-in, as a user calls them."""

import json
from pathlib import Path

import pytest

from eha_bench.comparison_api import ab
from eha_bench.core.errors import InputError
from forked import Forked

from .conftest import SUITE, Cli

# not what this run of pytest was asked for
PYTEST = """\
import os, pytest, sys
for name in [name for name in os.environ if name.startswith("PYTEST")]:
    del os.environ[name]
sys.exit(pytest.main(sys.argv[1:]))
"""


def test_a_result_compared_with_itself_is_no_regression(cli: Cli, ran: Path) -> None:
    done = cli("compare", ran, ran, "--json", check=0)
    content = json.loads(done.stdout)
    assert (content["schema_version"], content["status"]) == (1, "no_regression")
    assert {item["verdict"] for item in content["metrics"]} <= {"same", "not_compared"}
    assert cli("compare", ran, ran, check=0).stdout.strip() == "reports/comparison/comparison.html"
    assert cli("compare", ran, ran, "--markdown", check=0).stdout.startswith("## ✅")


def test_a_slower_candidate_is_a_regression(cli: Cli, ran: Path, tmp_path: Path) -> None:
    content = json.loads((ran / "result.json").read_text(encoding="utf-8"))
    for trial in content["trials"]:
        for score in trial["scores"]:
            if score["metric"] in ("tracking_rms", "tracking_max") and score["value"] is not None:
                for key in ("value", "low", "high"):
                    score[key] = score[key] and 3.0 * score[key]
    slower = tmp_path / "slower"
    slower.mkdir()
    (slower / "result.json").write_text(json.dumps(content), encoding="utf-8")
    done = cli("compare", ran, slower, check=1)
    assert "worse" in done.stderr


def test_a_comparison_that_decides_nothing_is_not_green(
    cli: Cli, ran: Path, tmp_path: Path
) -> None:
    content = json.loads((ran / "result.json").read_text(encoding="utf-8"))
    content["trials"] = [trial for trial in content["trials"] if trial["id"] == "sine"]
    for side, factor in (("a", 1.0), ("b", 1.02)):
        for trial in content["trials"]:
            trial["scores"] = [score for score in trial["scores"] if score["value"]]
            for score in trial["scores"]:
                score["value"] *= factor
        (tmp_path / side).mkdir()
        (tmp_path / side / "result.json").write_text(json.dumps(content), encoding="utf-8")
    done = cli("compare", tmp_path / "a", tmp_path / "b", "--markdown", check=0)
    assert "no regression shown: All " in done.stderr
    assert "metrics are undecided" in done.stderr
    assert done.stdout.startswith("## ❔ tiny: no regression shown")
    page = Path("reports/comparison/comparison.html").read_text(encoding="utf-8")
    assert 'class="verdict undecided"' in page


def test_limits_that_became_stricter_are_no_green_verdict(cli: Cli, ran: Path, suite: Path) -> None:
    suite.write_text(SUITE.replace("max: 12 A", "max: 1 A"), encoding="utf-8")
    cli("run", suite, "--out", "strict", check=1)
    done = cli("compare", ran, "strict", "--markdown", check=0)
    assert "no regression, but 1 limit newly missed: " in done.stderr
    (turned,) = [line for line in done.stderr.splitlines() if line.startswith("limit newly missed")]
    assert turned.replace("\xa0", " ").endswith("≤ 1 A (in the baseline ≤ 12 A)")
    assert done.stdout.startswith("## ⚠️ tiny: no regression, but 1 limit newly missed")
    page = Path("reports/comparison/comparison.html").read_text(encoding="utf-8")
    assert 'class="verdict warned"' in page
    assert 'class="verdict passed"' not in page
    # and the other way round
    done = cli("compare", "strict", ran, check=0)
    assert "limit kept again: hold: " in done.stderr
    assert "no regression: " in done.stderr


def test_bad_input_is_a_sentence_and_exit_status_2(cli: Cli, ran: Path) -> None:
    assert "no such result" in cli("compare", ran, "nothing", check=2).stderr
    assert "no such folder" in cli("history", "nothing", check=2).stderr


def test_a_baseline_is_a_file_that_limits_and_comparisons_refer_to(
    cli: Cli, ran: Path, suite: Path, tmp_path: Path
) -> None:
    cli("baseline", "baselines/tiny.json", ran, check=0)
    assert "what changes" in cli("baseline", "baselines/tiny.json", ran, check=0).stderr
    cli("compare", "baselines/tiny.json", ran, check=0)
    text = suite.read_text(encoding="utf-8")
    text = text.replace("name: tiny", "name: tiny\nbaseline: baselines/tiny.json")
    suite.write_text(text.replace("max: 12 A", "limit: <= 101 % of baseline"), encoding="utf-8")
    cli("run", suite, "--out", "relative", check=0)
    suite.write_text(SUITE.replace("max: 12 A", "max: 1 A"), encoding="utf-8")
    cli("run", suite, "--out", "missed", check=1)
    assert "--failed" in cli("baseline", "baselines/tiny.json", "missed", check=2).stderr


def test_ab_runs_in_turn_stops_and_resumes(cli: Cli, suite: Path, tmp_path: Path) -> None:
    suite.write_text(SUITE.partition("  - id: sine")[0], encoding="utf-8")
    wanted = ("ab", suite, "--a", "simulator", "--b", "simulator", "--repeats", "3", "--out", "ab")
    done = cli(*wanted, "--warm-up", "0", "--json", check=0)
    content = json.loads(done.stdout)
    assert content["paired"] is True
    assert content["status"] == "no_regression"
    plan = json.loads((tmp_path / "ab" / "ab.json").read_text(encoding="utf-8"))
    assert plan["order"][0] == plan["order"][1][::-1]
    first = (tmp_path / "ab" / "a" / "000-hold" / "result.json").stat().st_ctime_ns
    again = cli(*wanted, "--resume", check=0)
    assert "pairs were run" in again.stderr
    kept = sorted((tmp_path / "ab" / "a").glob("*/recordings/*.mcap"))
    assert all(path.stat().st_mtime_ns <= first for path in kept[:1])
    refused = cli(*wanted[:-4], "--repeats", "5", "--out", "ab", "--resume", check=2)
    assert "started with another" in refused.stderr


# the command, with a Ctrl-C as the third pair begins; after that pair, both sides being the same
# simulator, all is decided
PRESS = """\
import os, signal
from eha_bench.bench import interleaved
from eha_bench.cli.main import main
run_suite = interleaved.run_suite
def pressed(suite, target, folder, **options):
    if folder.name.startswith("002-"):
        os.kill(os.getpid(), signal.SIGINT)
    return run_suite(suite, target, folder, **options)
interleaved.run_suite = pressed
main()
"""


@pytest.mark.slow
def test_ab_that_is_interrupted_keeps_what_ran_and_goes_on(
    cli: Cli, forked: Forked, suite: Path, tmp_path: Path
) -> None:
    suite.write_text(SUITE.partition("  - id: sine")[0], encoding="utf-8")
    wanted = ["ab", suite, "--a", "simulator", "--b", "simulator", "--out", "ab", "--warm-up", "0"]
    words = [str(word) for word in (*wanted, "--repeats", "60")]
    done = forked.run(*words, folder=tmp_path, code=PRESS)
    assert done.returncode == 130, done.stderr
    assert "interrupted: go on with --resume" in done.stderr
    assert "Traceback" not in done.stderr
    assert "the run was stopped (incomplete)" in done.stderr
    ended = []
    for side in "ab":
        content = json.loads((tmp_path / "ab" / side / "result.json").read_text(encoding="utf-8"))
        assert content["status"] == "incomplete"
        # a run that was interrupted is there, and not scored
        ended.append(sum(trial["status"] == "passed" for trial in content["trials"]))
    # the signal is noticed within the first run of the third pair, or just before: then that ends
    assert ended in ([2, 2], [2, 3])
    found = json.loads((tmp_path / "ab" / "comparison.json").read_text(encoding="utf-8"))
    assert max(item["baseline"]["runs"] for item in found["metrics"]) == 2
    first = sorted((tmp_path / "ab").glob("?/000-hold/recordings/*.mcap"))
    kept = [file.stat().st_mtime_ns for file in first]
    assert len(kept) == 2
    resumed = cli(*words, "--resume", check=0)
    assert "3 of 60 pairs were run" in resumed.stderr
    assert "every metric was decided" in resumed.stderr
    assert [file.stat().st_mtime_ns for file in first] == kept


def test_a_history_of_runs_is_a_site(cli: Cli, ran: Path, tmp_path: Path) -> None:
    done = cli("history", tmp_path, "--out", "site", check=0)
    assert done.stdout.strip() == "site/index.html"
    assert (tmp_path / "site" / "index.html").is_file()


@pytest.mark.slow
def test_pytest_runs_a_suite_limit_by_limit(forked: Forked, suite: Path, tmp_path: Path) -> None:
    suite.write_text(SUITE.replace("max: 12 A", "max: 1 A"), encoding="utf-8")
    (tmp_path / "broken.yaml").write_text("name: [", encoding="utf-8")
    failed = forked.run(
        "-q", "-rA", "-p", "no:cacheprovider", "--eha-suite", suite.name,
        "--eha-suite", "broken.yaml", "--continue-on-collection-errors",
        "-W", "ignore::pytest.PytestAssertRewriteWarning",  # what is imported is not rewritten
        folder=tmp_path, code=PYTEST,
    )  # fmt: skip
    assert failed.returncode == 1
    assert "1 failed, 1 passed, 1 error" in failed.stdout
    assert (tmp_path / "reports" / "tiny" / "report.html").is_file()
    assert "tracking_max failed" in failed.stdout
    assert "Traceback" not in failed.stdout
    assert "not valid YAML" in failed.stdout


def test_a_seed_is_not_negative(cli: Cli, suite: Path) -> None:
    done = cli("ab", suite, "--a", "simulator", "--b", "simulator", "--seed", "-1", check=2)
    assert "--seed" in done.stderr
    with pytest.raises(InputError, match="seed of -1 is negative"):
        ab(suite, "simulator", "simulator", seed=-1)


def test_a_baseline_is_no_folder(cli: Cli, ran: Path) -> None:
    done = cli("baseline", "ran", "ran", check=2)
    assert "ran: a baseline is a file, and this is a folder" in done.stderr


@pytest.mark.parametrize("command", ["compare", "history", "score"])
def test_what_cannot_be_written_into_is_said_first(cli: Cli, ran: Path, command: str) -> None:
    Path("file").touch()
    given = {
        "compare": ["ran", "ran"], "history": ["ran"], "score": ["ran/recordings/hold-0.mcap"],
    }[command]  # fmt: skip
    done = cli(command, *given, "--out", "file/below", check=2)
    assert "file/below: cannot be made: 'file' is a file" in done.stderr


def test_a_history_of_nothing_leaves_nothing_behind(cli: Cli) -> None:
    Path("empty").mkdir()
    done = cli("history", "empty", check=2)
    assert "holds no result" in done.stderr
    assert list(Path("empty").iterdir()) == []


def test_one_run_a_side_decides_nothing_wherever_it_is_printed(
    cli: Cli, ran: Path, tmp_path: Path
) -> None:
    content = json.loads((ran / "result.json").read_text(encoding="utf-8"))
    content["trials"] = [trial for trial in content["trials"] if trial["id"] == "sine"]
    for name, factor in (("one", 1.0), ("other", 3.0)):
        for score in content["trials"][0]["scores"]:
            for key in ("value", "low", "high"):
                score[key] = score[key] and factor * score[key]
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(json.dumps(content), encoding="utf-8")
    done = cli("compare", "one", "other", "--markdown", check=0)
    assert "undecided: One run a side. " in done.stderr
    assert "One run a side" in done.stdout
    assert "One run a side" in Path("reports/comparison/comparison.html").read_text("utf-8")
    content = json.loads(cli("compare", "one", "other", "--json", check=0).stdout)
    verdicts = {item["verdict"] for item in content["metrics"] if item["difference"]}
    assert verdicts == {"undecided"}
    reasons = [item["reason"] for item in content["metrics"] if item["verdict"] == "undecided"]
    assert all("one run a side" in reason for reason in reasons)
