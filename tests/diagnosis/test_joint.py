"""Two effects that are looked for at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from fixtures.rig.case import Conditions, Plan, record_case
from fixtures.rig.plans import by_id

from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import calibrated_baseline
from eha_bench.diagnosis.search.joint import joint
from eha_bench.diagnosis.search.state import begin


@pytest.mark.slow(31)
def test_two_effects_are_found_from_the_calibrated_model_alone(tmp_path: Path) -> None:
    hidden = (by_id("seal_friction")[0], by_id("torque_saturation")[0])
    plan = Plan("case", "two", hidden, ("strong", "middle"), (1, 2, 3))
    search = begin(calibrated_baseline(load_dataset(record_case(plan, tmp_path, Conditions()))))
    assert joint(search)
    assert {item.start.candidate for item in search.effects} == {item.id for item in hidden}
    assert search.excess_left.total < 0.2 * search.excess_base.total


@pytest.mark.slow
def test_no_pair_is_made_of_what_is_outside_the_list(tmp_path: Path) -> None:
    plan = Plan("case", "foreign", tuple(by_id("supply_sag")), ("strong",), (1, 2, 4))
    search = begin(calibrated_baseline(load_dataset(record_case(plan, tmp_path, Conditions()))))
    fit = search.fit
    assert not joint(search)
    assert search.fit is fit
    assert not search.accepted
