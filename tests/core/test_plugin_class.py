"""A plug-in that misspells what its base calls is refused before anything runs."""

import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Literal

import pytest

from eha_bench.control.controller import Controller
from eha_bench.control.controller_file import load_controllers
from eha_bench.core import file_kind, plugins
from eha_bench.core.errors import InputError, PluginError
from eha_bench.core.metric import METRICS
from eha_bench.core.plugin_class import check_class
from eha_bench.metrics.metric import Metric
from eha_bench.metrics.scoring import metric
from eha_bench.plants.effect import Action, Effect, Hook, Spot, bind_effects, registered_effects
from eha_bench.plants.network.network import element_kinds
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.plant import Plant
from eha_bench.plants.registry import get_plant
from eha_bench.suites import load_suite
from eha_bench.suites.signals.signal_model import SignalModel
from eha_bench.targets.resolve import open_target
from eha_bench.targets.target import Identity, Target

Install = Callable[[str, Any], None]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Install:
    """Register an object as the entry point `own` of a group, besides those there are."""
    real = plugins._group

    def register(group: str, found: Any) -> None:
        module = ModuleType("own_plugin")
        module.found = found  # type: ignore[attr-defined]  # as a package would define it
        monkeypatch.setitem(sys.modules, "own_plugin", module)
        point = EntryPoint("own", "own_plugin:found", f"eha_bench.{group}")
        monkeypatch.setattr(
            plugins, "_group", lambda name: real(name) | ({"own": point} if name == group else {})
        )

    return register


class Rig(Target):
    """A target with all that is required, and no more."""

    @property
    def identity(self) -> Identity:
        return Identity("own")

    def check(self, trial): ...

    def run(self, trial, repeat, stopping): ...


def _with(base: type, name: str, value: object = lambda self: None) -> type:
    return type("Own", (base,), {name: value})


@pytest.mark.parametrize(
    "name", ["make_saf", "makesafe", "make_save", "makeSafe", "MakeSafe", "mak_safe", "make_safely"]
)
def test_a_target_that_would_not_be_made_safe_is_refused(
    tmp_path: Path, install: Install, name: str
) -> None:
    kind = _with(Rig, name)
    install("targets", lambda path, content: kind())
    file = tmp_path / "target.yaml"
    file.write_text("# mine\ntarget: own\n")
    with pytest.raises(PluginError) as caught:
        open_target(file)
    assert str(caught.value).startswith(
        f"{file}:2, key 'target': target 'own' defines '{name}', which nothing calls; "
        "did you mean 'make_safe'?"
    )


@pytest.mark.parametrize("name", ["current", "channels", "_make_safe", "safe", "port", "reached"])
def test_names_of_its_own_are_a_targets_business(install: Install, name: str) -> None:
    kind = _with(Rig, name)
    install("targets", lambda path, content: kind())
    assert isinstance(open_target({"target": "own"}), kind)


def test_a_near_name_beside_the_right_one_is_no_slip() -> None:
    check_class(_with(_with(Rig, "make_safe"), "make_safely"), Target, "target 'own'")


class Law(Controller):
    """A control law whose gains nobody would read."""

    def __init__(self, gains, context): ...

    def step(self, reference, reading):
        return 0.0


def test_a_controllers_gains_have_their_name(tmp_path: Path, install: Install) -> None:
    install("controllers", _with(Law, "gains", object))
    (tmp_path / "controller.yaml").write_text("current: {controller: own}\n")
    with pytest.raises(InputError, match="'gains', which nothing calls; did you mean 'Gains'"):
        load_controllers(tmp_path / "controller.yaml")


class Ramp(SignalModel):
    """A signal without features."""

    kind: Literal["own"]

    @property
    def duration(self):
        return 1.0

    def __call__(self, time):
        return time


class Hidden(Ramp):
    """One that misspells them."""

    @property
    def edge(self):
        return ()


class Endless(SignalModel):
    """One without a duration."""

    kind: Literal["own"]

    def __call__(self, time):
        return time

    def durations(self):
        return ()


@pytest.mark.parametrize(
    ("signal", "says"),
    [
        (Hidden, "signal 'own' defines 'edge', which nothing calls; did you mean 'edges'"),
        (Endless, "does not define duration; write the method, or rename 'durations'"),
    ],
)
def test_a_signals_features_have_their_names(
    tmp_path: Path, install: Install, signal: type, says: str
) -> None:
    install("signals", signal)
    (tmp_path / "suite.yaml").write_text(
        "name: own\ntrials:\n  - {id: one, mode: current, signal: {kind: own}}\n"
    )
    with pytest.raises(InputError, match=says) as caught:
        load_suite(tmp_path / "suite.yaml")
    assert caught.value.where.line == 3


class Own(Metric):
    """A metric that lacks its spec."""

    def applies(self, trial):
        return True

    def measure(self, recording, trial, channel): ...


class OnRequest(Own):
    """One that is computed everywhere all the same."""

    spec = METRICS["rise_time"]
    by_defalt: ClassVar[bool] = False


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (Own, "metric 'own' does not have spec; set it in the class"),
        (Own(), "metric 'own' does not have spec"),
        (OnRequest(), "'by_defalt', which nothing calls; did you mean 'by_default'"),
        (OnRequest, "'by_defalt', which nothing calls"),
    ],
)
def test_a_metric_says_what_it_is(install: Install, made: object, says: str) -> None:
    install("metrics", made)
    metric.cache_clear()
    with pytest.raises(PluginError, match=says):
        metric("own")
    metric.cache_clear()


class Shaft(Plant):
    """A plant without channels."""

    id = "own"
    layout: Any = None
    states = ()


class Turning(Shaft):
    """One that never advances."""

    outputs = ()

    def advanced(self): ...


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (Shaft, "plant 'own' does not have outputs"),
        (Turning, "plant 'own' defines 'advanced', which nothing calls; did you mean 'advance'"),
    ],
)
def test_a_plant_has_what_a_plant_has(install: Install, made: type, says: str) -> None:
    install("plants", made)
    with pytest.raises(PluginError, match=says):
        get_plant("own")


def test_a_kind_of_file_is_one(install: Install) -> None:
    install("file_kinds", object())
    with pytest.raises(PluginError, match="file kind 'own' is not a FileKind but object"):
        file_kind.kinds()


def test_two_packages_may_not_give_one_name_to_two_things(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("rise_time", "mine:RiseTime", "eha_bench.metrics")
    real = plugins._entry_points()
    known = [
        each for group in ("metrics", "signals") for each in real.select(group=f"eha_bench.{group}")
    ]
    monkeypatch.setattr(plugins, "_entry_points", lambda: EntryPoints([*known, point, point]))
    plugins._group.cache_clear()
    says = r"two packages provide the metric 'rise_time': .*\(mine:RiseTime\)"
    with pytest.raises(PluginError, match=says):
        plugins.load("metrics", "rise_time")
    assert "step" in plugins.names("signals")
    plugins._group.cache_clear()


def test_a_copy_that_keeps_its_id_hides_nothing(
    install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    install("effects", _effect(id="backlash", actions={}))
    registered_effects.cache_clear()
    with pytest.raises(
        PluginError, match=r"'own' of eha_bench.effects names the effect 'backlash'"
    ):
        registered_effects()
    install("elements", replace(plugins.load("elements", "pump")))
    element_kinds.cache_clear()
    with pytest.raises(PluginError, match=r"'own' of eha_bench.elements names the element 'pump'"):
        element_kinds()
    element_kinds.cache_clear()


def _effect(**more: Any) -> Effect:
    size = Parameter("size", "", 0.0, 0.0, 1.0)
    return Effect(**({"id": "own", "summary": "", "parameters": (size,), "source": ""} | more))


def _hold(value: float) -> float:
    return value


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"actions": {"pump": Action(advance={"heigth": _hold})}, "states": ("height",)},
         "names the state 'heigth', which it does not have; did you mean 'height'"),
        ({"actions": {"pump": Action(start={"height": _hold})}}, "there are none"),
        ({"actions": {"pump": Action(charges="sise")}}, "'sise'.*did you mean 'size'"),
        ({"actions": {"pump": Action(chosen_by="kind")}}, "names the parameter 'kind'"),
        ({"actions": {}, "starts": ({"sice": 1.0},)}, "'sice'.*did you mean 'size'"),
    ],
)  # fmt: skip
def test_an_effect_names_what_it_has(more: dict[str, Any], says: str) -> None:
    with pytest.raises(PluginError, match=says):
        _effect(**more)


def test_an_effect_acts_at_hooks_that_its_role_has() -> None:
    spot = Spot("pump", None, {"dry_friction": (Hook("pump_dry"),)})  # type: ignore[arg-type]  # no balance
    right = _effect(actions={"pump": Action({"dry_friction": _hold})})
    assert [item.id for item in bind_effects([right], {"pump": [spot]})] == ["own"]
    wrong = _effect(actions={"pump": Action({"dry_frction": _hold})})
    assert bind_effects([wrong], {"valve": [spot]}) == ()
    with pytest.raises(PluginError, match=r"the hook 'dry_frction'.*did you mean 'dry_friction'"):
        bind_effects([wrong], {"pump": [spot]})
