"""docs/metrics.md explains every metric that is built in, as the registry has it."""

import re

import pytest

from eha_bench.core.metric import METRICS
from eha_bench.metrics import all_metrics

FIELDS = ("Definition", "Interval", "Not scored", "Source")


@pytest.fixture(scope="module")
def sections(repository):
    text = (repository / "docs" / "metrics.md").read_text(encoding="utf-8")
    parts = re.split(r"^### (\w+)$", text, flags=re.MULTILINE)
    found = dict(zip(parts[1::2], parts[2::2], strict=True))
    assert len(found) == len(parts) // 2, "an id has two sections"
    return found


def built_in():
    metrics = all_metrics()
    ours = {name: one for name, one in metrics.items() if type(one).__module__[:10] == "eha_bench."}
    assert set(METRICS) <= set(ours)
    return ours


def test_every_metric_has_its_section_and_no_other(sections):
    lacking, left = set(built_in()) - set(sections), set(sections) - set(built_in())
    assert not lacking, f"docs/metrics.md has no section '### {min(lacking)}'"
    assert not left, f"docs/metrics.md has a section '### {min(left)}', and there is no such metric"


@pytest.mark.parametrize("name", sorted(built_in()))
def test_a_section_says_what_the_registry_says(sections, name):
    section, metric = sections[name], built_in()[name]
    spec = metric.spec
    assert spec.description.lower() in section.lower()
    unit = "unit of its channel" if spec.unit is None else spec.unit or "1"
    assert f"**Unit**: {unit};" in section
    channel = {"": "the recording as a whole", None: "the channel that the reference asks for"}
    assert f"**scored on** {channel.get(spec.channel, f'`{spec.channel}`')}" in section
    assert f"**default**: {'yes' if metric.by_default else 'no'}" in section
    for field in FIELDS:
        said = re.search(rf"^- \*\*{field}\*\*: (.+)", section, re.MULTILINE)
        assert said, f"docs/metrics.md, section '{name}', has no line '- **{field}**: ...'"
        other = re.fullmatch(r"as (\w+)", said[1])
        assert not other or other[1] in sections, said[0]


def test_the_contract_s_ids_are_there():
    contract = (
        "rise_time response_time settling_time overshoot undershoot peak peak_time delay_time "
        "steady_state_error holding_current tracking_rms tracking_max tracking_nrmse "
        "amplitude_ratio phase_lag time_lag distortion bandwidth_3db bandwidth_90deg loop_overruns"
    )
    assert list(METRICS) == contract.split()
