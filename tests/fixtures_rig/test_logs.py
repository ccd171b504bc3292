"""The files are those of the sample rig: same layout, same bytes for the same values."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fixtures.rig.case import Conditions, record_case
from fixtures.rig.commands import build_runs
from fixtures.rig.foreign import FOREIGN
from fixtures.rig.forms import OTHER, nearly_as_declared, other_form
from fixtures.rig.hidden import LEVELS
from fixtures.rig.levels import read_levels
from fixtures.rig.listed import LISTED
from fixtures.rig.mcap_log import write_log
from fixtures.rig.plans import by_id, make_plans, recorded_otherwise
from fixtures.rig.plant import Plant
from fixtures.rig.sensors import COLUMNS, FLOOR, SIGMA, Bench, measured, wandering
from fixtures.rig.transport import IMPERFECTIONS, MESSY, Transport, arrivals
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

SHORT = Conditions(duration=0.5)
LONGER = round(Conditions().duration / SHORT.duration)
"""How many times as long as a short log a sample is."""
PERIOD = 1_000_000
"""Of the samples' clock, ns."""
YAML_FILES = ["dataset.yaml", "model.yaml", *(f"channels_{i}.yaml" for i in range(3))]


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rig")
    plan = make_plans(5, 0, none=1)[0]
    return record_case(plan, out, SHORT).parent


def description(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        header = reader.get_header()
        assert summary is not None
        assert summary.statistics is not None
        return {
            "profile": header.profile,
            "library": header.library,
            "schemas": {s.name: (s.encoding, s.data) for s in summary.schemas.values()},
            "channels": [
                (c.topic, c.message_encoding, summary.schemas[c.schema_id].name)
                for c in summary.channels.values()
            ],
            "counts": summary.statistics.channel_message_counts,
            "start": summary.statistics.message_start_time,
            "end": summary.statistics.message_end_time,
            "compression": {c.compression for c in summary.chunk_indexes},
        }


def lasting(found: dict[str, Any], times: int) -> dict[str, Any]:
    """The description of a log that is so many times as long."""
    start, end = found["start"], found["end"]
    counts = {channel: times * count for channel, count in found["counts"].items()}
    return found | {"counts": counts, "end": start + times * (end - start + PERIOD) - PERIOD}


def test_yaml_is_the_samples_word_for_word(case: Path, shared_data: Path) -> None:
    sample = shared_data / "rig_samples" / "D"
    for name in YAML_FILES:
        assert (case / name).read_text() == (sample / name).read_text(), name


def test_logs_are_the_samples_in_form(case: Path, shared_data: Path) -> None:
    sample = shared_data / "rig_samples" / "D"
    assert {p.name for p in case.iterdir()} == {p.name for p in sample.iterdir()}
    for path in sorted(sample.glob("*.mcap")):
        assert lasting(description(case / path.name), LONGER) == description(path), path.name


def test_rewriting_a_sample_gives_its_messages_byte_for_byte(
    shared_data: Path, tmp_path: Path
) -> None:
    path = shared_data / "rig_samples" / "D" / "free_sine.mcap"
    values: dict[str, list[list[float]]] = {}
    raw: dict[str, list[bytes]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, ros in reader.iter_decoded_messages():
            raw.setdefault(channel.topic, []).append(message.data)
            if hasattr(ros, "data"):
                row = [ros.data]
            elif hasattr(ros, "fluid_pressure"):
                row = [ros.fluid_pressure]
            else:
                row = [ros.effort[0], ros.velocity[0], ros.position[1], ros.velocity[1]]
            values.setdefault(channel.topic, []).append(row)
    state = np.array(values["/drive/state"])
    measured = np.column_stack(
        [
            state[:, 0],
            state[:, 1] * np.pi / 30.0,
            np.array(values["/block/p_a"])[:, 0] * 1e5,
            np.array(values["/block/p_b"])[:, 0] * 1e5,
            state[:, 2],
            state[:, 3],
        ]
    )
    count = len(state)
    out = tmp_path / "again.mcap"
    write_log(
        out,
        np.array(values["/bench/reference"])[:, 0],
        np.array(values["/drive/current_cmd"])[:, 0],
        measured,
        arrivals(
            Transport(),
            np.arange(count, dtype=np.int64) * 1_000_000,
            np.ones(count, dtype=bool),
            np.random.default_rng(0),
        ),
    )
    again: dict[str, list[bytes]] = {}
    with out.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            again.setdefault(channel.topic, []).append(message.data)
    for topic in ("/bench/reference", "/drive/current_cmd", "/block/p_a", "/block/p_b"):
        a = np.frombuffer(b"".join(raw[topic]), np.uint8).reshape(count, -1)
        b = np.frombuffer(b"".join(again[topic]), np.uint8).reshape(count, -1)
        # The last bit of a decimal may round otherwise; everything else is equal.
        assert a.shape == b.shape
        assert np.mean(a != b) < 0.01, topic
    joints = np.frombuffer(b"".join(raw["/drive/state"]), np.uint8).reshape(count, -1)
    mine = np.frombuffer(b"".join(again["/drive/state"]), np.uint8).reshape(count, -1)
    assert joints.shape == mine.shape
    # Up to the speed, which went through rad/s and back, all bytes are the same.
    assert np.array_equal(joints[:, :60], mine[:, :60])
    assert np.array_equal(joints[:, 84:], mine[:, 84:])


def test_the_same_plan_gives_the_same_bytes(tmp_path: Path) -> None:
    plan = make_plans(9, 1, effects=["cogging_torque"])[0]
    folders = [record_case(plan, tmp_path / name, SHORT).parent for name in ("a", "b")]
    for path in sorted(folders[0].iterdir()):
        assert path.read_bytes() == (folders[1] / path.name).read_bytes(), path.name
    truths = [(tmp_path / name / "truth" / f"{plan.name}.yaml").read_text() for name in ("a", "b")]
    assert truths[0] == truths[1]


def test_what_is_hidden_is_not_in_the_case_folder(tmp_path: Path) -> None:
    plan = make_plans(2, 1, effects=["entrained_air"], strengths=["strong"])[0]
    folder = record_case(plan, tmp_path, SHORT).parent
    for path in folder.iterdir():
        assert b"entrained" not in path.read_bytes(), path.name
    assert "entrained_air" in (tmp_path / "truth" / f"{plan.name}.yaml").read_text()
    assert "entrained_air" not in folder.name


def test_models_of_cases_that_change_the_declaration(tmp_path: Path) -> None:
    plan = make_plans(2, 1, effects=["anti_cavitation"])[0]
    text = (record_case(plan, tmp_path, SHORT).parent / "model.yaml").read_text()
    assert "anti_cavitation" not in text
    plan = make_plans(3, 1, effects=["coulomb_friction"])[0]
    text = (record_case(plan, tmp_path, SHORT).parent / "model.yaml").read_text()
    assert "coulomb_torque: 0.0" in text
    assert "coulomb_torque" not in text.split("calibrate:")[1]


@pytest.mark.slow  # a whole case
def test_a_messy_log_is_like_the_sample_recorded_as_one(shared_data: Path, tmp_path: Path) -> None:
    plan = make_plans(4, 0, none=1)[0]
    folder = record_case(plan, tmp_path, Conditions(transport=MESSY)).parent

    def phases(path: Path) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {}
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
                found.setdefault(channel.topic, []).append(message.log_time)
        return found

    mine = phases(folder / "locked_stairs.mcap")
    sample = phases(shared_data / "rig_samples" / "M" / "locked_stairs.mcap")
    assert mine.keys() == sample.keys()
    for topic, stamps in sample.items():
        assert len(mine[topic]) == pytest.approx(len(stamps), abs=0.01 * len(stamps)), topic
        late, as_late = (np.array(t) % 1_000_000 for t in (mine[topic], stamps))
        for share in (0, 25, 50, 75, 100):
            gap = np.percentile(late, share) - np.percentile(as_late, share)
            assert abs(gap) < 4_000, topic


@pytest.mark.parametrize("word", IMPERFECTIONS)
def test_one_imperfection_is_that_one_alone(word: str) -> None:
    ticks = np.arange(4000, dtype=np.int64) * 1_000_000
    here = np.ones(4000, dtype=bool)
    log = arrivals(IMPERFECTIONS[word], ticks, here, np.random.default_rng(0))
    lost = {topic for topic, (_, kept) in log.items() if not kept.all()}
    late = {topic for topic, (stamps, _) in log.items() if (stamps > ticks).any()}
    every, pressures = set(log), {"/block/p_a", "/block/p_b"}
    assert (lost, late) == {
        "half_rate": ({"/drive/state"}, set()),
        "lost": (every, set()),
        "lost_commands": ({"/drive/current_cmd"}, set()),
        "jitter": (set(), every),
        "late": (set(), pressures),
    }[word]
    for stamps, kept in log.values():
        assert kept.mean() == pytest.approx(0.5 if word == "half_rate" else 0.99, abs=0.01) or (
            kept.all()
        )
        assert (stamps - ticks).max() <= 250_000


def test_a_bench_in_poor_shape(tmp_path: Path) -> None:
    plan = make_plans(4, 0, none=1)[0]
    bench = Bench(noise=5.0, dead="pressure_b", gap_hz=10.0, jitter=5e-5)
    conditions = Conditions(duration=0.8, closed_loop=True, bench=bench)
    folder = record_case(plan, tmp_path, conditions).parent
    counts = description(folder / "locked_stairs.mcap")["counts"]
    assert counts[1] == 800
    assert counts[3] == counts[4] < 800
    with (folder / "locked_stairs.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        dead = {
            ros.fluid_pressure
            for _, channel, _, ros in reader.iter_decoded_messages()
            if channel.topic == "/block/p_b"
        }
    assert len(dead) == 1
    assert "channels_1.yaml" in (folder / "dataset.yaml").read_text().splitlines()[4]


@pytest.mark.slow
def test_other_forms_are_drawn_for_effects_that_there_are() -> None:
    rng = np.random.default_rng(0)
    assert OTHER.keys() <= {effect.key for effect in LISTED}
    levels = read_levels()
    run = next(r for r in build_runs(np.random.default_rng(0)) if r.name == "locked_steps")
    free = next(r for r in build_runs(np.random.default_rng(0)) if r.name == "free_swing")
    for effect in LISTED:
        plain = effect.settings(levels[effect.key]["strong"], np.random.default_rng(0))
        other = plain | other_form(effect, rng)
        if effect.key not in OTHER:
            assert other == plain
            continue
        driven = free if effect.needs_free_motion else run
        readings, moved = (Plant(s).run(driven)[0] for s in (plain, other))
        assert np.isfinite(moved).all(), effect.key
        if other != plain:
            assert np.abs((moved - readings) / FLOOR).max() > 0.05, effect.key


def test_what_is_declared_is_off_by_less_than_the_noise() -> None:
    rng = np.random.default_rng(0)
    run = next(r for r in build_runs(np.random.default_rng(0)) if r.name == "bypass_ramps")
    declared = Plant({}).run(run)[0]
    for _ in range(4):
        off = (Plant(nearly_as_declared(rng)).run(run)[0] - declared) / FLOOR
        assert np.sqrt(np.mean(off**2, axis=0)).max() < 1.0


def test_a_case_of_other_forms_says_so_in_its_truth_alone(tmp_path: Path) -> None:
    plan = make_plans(8, 1, effects=["external_leakage"], strengths=["strong"])[0]
    conditions = Conditions(duration=0.5, other_forms=True)
    folder = record_case(plan, tmp_path, conditions).parent
    truth = (tmp_path / "truth" / f"{plan.name}.yaml").read_text()
    assert "external_drain" in truth
    assert "other_forms: true" in truth
    with (folder / "locked_stairs.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        efforts = {
            ros.effort[0]
            for _, channel, _, ros in reader.iter_decoded_messages()
            if channel.topic == "/drive/state"
        }
    steps = np.array(sorted(efforts)) / 0.05
    assert np.abs(steps - np.round(steps)).max() < 1e-6


def test_a_wandering_zero_stays_as_small_as_said() -> None:
    path = wandering(200_000, np.random.default_rng(0))
    assert np.std(path, axis=0) == pytest.approx(np.ones(6), rel=0.4)
    assert np.abs(np.diff(path, axis=0)).max() < 0.3


def test_sets_are_even_and_names_tell_nothing() -> None:
    plans = make_plans(1, 72, two=5, none=7, foreign=24)
    assert len(plans) == 108
    assert [p.name for p in plans] == sorted(p.name for p in plans)
    singles = [p for p in plans if p.kind == "single"]
    assert len({(p.hidden[0].key, p.levels[0]) for p in singles}) == 72
    assert [p.kind for p in plans] != sorted(p.kind for p in plans)
    with pytest.raises(ValueError, match="there are"):
        by_id("perpetual_motion")


def test_a_small_set_is_drawn_from_all_effects_and_strengths() -> None:
    first, second = (
        [(p.hidden[0].key, p.levels[0]) for p in make_plans(seed, 12, drawn=True)]
        for seed in (11, 12)
    )
    assert len(set(first)) == 12
    assert set(first) != set(second)
    assert len({level for _, level in first}) == 3
    whole = [(p.hidden[0].key, p.levels[0]) for p in make_plans(11, 72, drawn=True)]
    assert len(set(whole)) == 72
    # the other cases of a seed stay what they are
    kinds = [p.kind for p in make_plans(11, 5, two=2, none=1, foreign=1)]
    assert [p.kind for p in make_plans(11, 5, two=2, none=1, foreign=1, drawn=True)] == kinds


def test_a_case_of_another_set_is_known_by_its_truth(tmp_path: Path) -> None:
    (plan,) = make_plans(3, 1, effects=["external_leakage"])
    assert not recorded_otherwise(plan, tmp_path)
    record_case(plan, tmp_path, Conditions(duration=0.05))
    assert not recorded_otherwise(plan, tmp_path)
    (other,) = make_plans(4, 1, effects=["external_leakage"])
    assert recorded_otherwise(other, tmp_path)
    (other,) = make_plans(3, 1, effects=["entrained_air"])
    assert recorded_otherwise(other, tmp_path)


def test_columns_are_named_as_in_the_contract() -> None:
    assert COLUMNS[0] == "current"


def test_every_effect_has_three_growing_sizes() -> None:
    levels = read_levels()
    effects = (*LISTED, *FOREIGN)
    assert len({effect.key for effect in effects}) == len(effects)
    for effect in effects:
        sizes = [levels[effect.key][level] for level in LEVELS]
        assert 0.0 < sizes[0] < sizes[1] < sizes[2], effect.key


@pytest.mark.slow  # two runs of each effect
def test_every_effect_moves_what_is_measured() -> None:
    levels = read_levels()
    runs = [
        r for r in build_runs(np.random.default_rng(0)) if r.name in {"locked_steps", "free_swing"}
    ]
    plain = [Plant({}).run(run)[0] for run in runs]
    for effect in (*LISTED, *FOREIGN):
        settings = effect.settings(levels[effect.key]["strong"], np.random.default_rng(0))
        if effect.id == "anti_cavitation":
            settings = {"valve_conductance": 0.0}
        moved = [Plant(settings).run(run)[0] - was for run, was in zip(runs, plain, strict=True)]
        assert all(np.isfinite(m).all() for m in moved), effect.key
        assert max(np.sqrt(np.mean((m / FLOOR) ** 2)) for m in moved) > 1.0, effect.key


def test_the_ids_are_those_of_the_contract() -> None:
    assert {effect.id for effect in LISTED} == {
        "current_lag", "command_delay", "current_deadband", "torque_saturation", "cogging_torque",
        "pump_ripple", "pressure_dependent_friction", "viscosity_drift", "asymmetric_friction",
        "turbulent_leakage", "external_leakage", "entrained_air", "anti_cavitation",
        "relief_valve", "presliding_friction", "seal_friction", "joint_backlash", "gravity_load",
        "pressure_sensor_lag", "pressure_sensor_offset", "unequal_areas", "coulomb_friction",
    }  # fmt: skip
    assert not {e.id for e in FOREIGN} & {e.id for e in LISTED}
    equations = {"torque", "flow", "force", "measurement", "actuation"}
    assert {e.equation for e in FOREIGN} == equations


def test_noise_behind_a_filter_is_as_large_and_remembers() -> None:
    count = 20000
    still = np.zeros((count, 6))
    white = measured(still, Bench(), np.random.default_rng(0))
    slow = measured(still, Bench(memory=0.003), np.random.default_rng(0))
    for column, floor in enumerate(FLOOR):
        assert np.std(slow[:, column]) == pytest.approx(floor, rel=0.05)
        r = np.corrcoef(slow[1:, column], slow[:-1, column])[0, 1]
        assert r == pytest.approx(np.exp(-1.0 / 3.0) * (SIGMA[column] / floor) ** 2, abs=0.02)
        assert abs(np.corrcoef(white[1:, column], white[:-1, column])[0, 1]) < 0.03
