"""Every mistake in a plant.yaml is named with file, line and key, and with the way out."""

from __future__ import annotations

from pathlib import Path

import pytest

from eha_bench.core.errors import InputError, Place
from eha_bench.plants.model import model_from
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.network.plant import NetworkPlant

PLANT = """\
plant: axis
nodes:
  shaft:     {kind: rotation, inertia: 9e-4 kg*m^2}
  chamber_a: {kind: volume, bulk_modulus: 1 GPa}
  chamber_b: {kind: volume, bulk_modulus: 1 GPa}
  tank:      {kind: reservoir, pressure: 3 bar}
  rod:       {kind: translation, mass: 60 kg, stroke: [-50 mm, 50 mm]}
elements:
  motor:    {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  pump:     {kind: pump, on: shaft, from: chamber_b, to: chamber_a, displacement: 0.69 cm^3/rev}
  cylinder: {kind: cylinder, on: rod, a: chamber_a, b: chamber_b, area_a: 12 cm^2, area_b: 12 cm^2,
             dead_volume_a: 10 cm^3, dead_volume_b: 10 cm^3}
  seals:    {kind: friction, on: rod, coulomb: 60 N}
  leak:     {kind: laminar_leakage, between: [chamber_a, chamber_b], conductance: 1e-13 m^3/(s*Pa)}
  suck:     {kind: check_valve, from: tank, to: chamber_a, conductance: 6e-10 m^3/(s*Pa)}
inputs:   {current_command: motor.current}
channels: {motor_speed: shaft.speed, pressure_a: chamber_a.pressure, piston_position: rod.position}
"""
SERVO = "  loop: {kind: position_servo, on: shaft, motor: motor, proportional: 6 A/rad}\n"
LINKAGE = (
    "  linkage: {{kind: knee_linkage, on: rod, to: shaft, link_a: 0.3 m, link_b: 0.05 m, "
    "link_c0: 0.3 m{}}}\n"
)
GAS = "  gas: {kind: accumulator, on: chamber_a, precharge: 3 bar, gas_volume: 1 l}\n"

# what is changed, into what, line and key that the message names, and what it says
MISTAKES = {
    "element on a node of the wrong kind": (
        "on: shaft, torque", "on: rod, torque", 9, "elements.motor.on",
        "joins a rotation, but 'rod' is a translation",
    ),
    "unknown kind of element": (
        "kind: pump", "kind: pomp", 10, "elements.pump.kind", "did you mean 'pump'",
    ),
    "kind of element that is not a name": (
        "kind: pump", "kind: [pump]", 10, "elements.pump.kind", "there is no kind",
    ),
    "element that needs what another one is declared without": (
        "  seals:", LINKAGE.format(", cylinder: cylinder") + "  seals:", 11, "elements.cylinder",
        "'linkage' (knee_linkage) needs 'volume_a' of 'cylinder', which is declared without it",
    ),
    "element that needs another one and names none": (
        "  seals:", LINKAGE.format("") + "  seals:", 13, "elements.linkage",
        "needs 'volume_a' of an element that it does not name; name it: `cylinder: ...`",
    ),
    "unknown kind of node": (
        "kind: rotation", "kind: rotatoin", 3, "nodes.shaft.kind", "did you mean 'rotation'",
    ),
    "kind left out": ("kind: pump, ", "", 10, "elements.pump", "key 'kind' is missing"),
    "element that is not a mapping": (
        "{kind: friction, on: rod, coulomb: 60 N}", "friction", 13, "elements.seals",
        "expected a kind and its parameters",
    ),
    "node that is not there": (
        "to: chamber_a, disp", "to: chamber_c, disp", 10, "elements.pump.to",
        "no node 'chamber_c'; did you mean 'chamber_",
    ),
    "unknown port": (
        "from: chamber_b, to: chamber_a, disp", "form: chamber_b, to: chamber_a, disp", 10,
        "elements.pump.form", "did you mean 'from'",
    ),
    "port left out": ("on: shaft, from", "from", 10, "elements.pump", "key 'on' is missing"),
    "unknown parameter": (
        "torque_constant", "torque_konstant", 9, "elements.motor.torque_konstant",
        "did you mean 'torque_constant'",
    ),
    "needed parameter left out": (
        ", displacement: 0.69 cm^3/rev", "", 10, "elements.pump", "needs 'displacement'",
    ),
    "unknown parameter of a node": (
        "inertia: 9e-4", "inertai: 9e-4", 3, "nodes.shaft.inertai", "did you mean 'inertia'",
    ),
    "node that nothing joins": (
        "elements:\n", "  spare: {kind: volume}\nelements:\n", 8, "nodes.spare",
        "nothing joins the volume 'spare'",
    ),
    "volume that holds no oil": (
        "elements:\n", "  dead: {kind: volume}\nelements:\n"
        "  more: {kind: laminar_leakage, between: [dead, tank], conductance: 1e-13 m^3/(s*Pa)}\n",
        8, "nodes.dead", "holds no oil",
    ),
    "element between a node and itself": (
        "[chamber_a, chamber_b]", "[chamber_a, chamber_a]", 14, "elements.leak", "with itself",
    ),
    "one node between": (
        "[chamber_a, chamber_b]", "[chamber_a]", 14, "elements.leak.between", "two nodes",
    ),
    "port said twice": (
        "between: [chamber_a, chamber_b]", "between: [chamber_a, chamber_b], first: tank", 14,
        "elements.leak.first", "already says",
    ),
    "channel of a state that is not there": (
        "shaft.speed", "shaft.pressure", 17, "channels.motor_speed", "it has: speed, angle",
    ),
    "channel of what an element does not show": (
        "shaft.speed", "pump.speed", 17, "channels.motor_speed", "a pump has no 'speed'",
    ),
    "channel of a node that is not there": (
        "shaft.speed", "shatf.speed", 17, "channels.motor_speed", "did you mean 'shaft'",
    ),
    "channel without a quantity": (
        "shaft.speed", "shaft", 17, "channels.motor_speed", "not of the form",
    ),
    "known channel of another quantity": (
        "motor_speed: shaft", "pressure_difference: shaft", 17, "channels.pressure_difference",
        "a channel in Pa, but what it names here is in rad/s",
    ),
    "channel that is also another input": (
        "motor_speed: shaft.speed", "current_command: shaft.speed", 17,
        "channels.current_command", "is also an input",
    ),
    "name of a channel that is none": (
        "motor_speed: shaft", "motor speed: shaft", 17, "channels.motor speed", "is not a name",
    ),
    "key that there is not": (
        "channels: {", "chanels: {}\nchannels: {", 17, "chanels", "did you mean 'channels'",
    ),
    "gear of no ratio": (
        "elements:\n", "  wheel: {kind: rotation, inertia: 1e-3 kg*m^2}\nelements:\n"
        "  up: {kind: gear, from: wheel, to: shaft, ratio: 0}\n",
        10, "elements.up.ratio", "ratio cannot be 0",
    ),
    "nodes that follow one another in a loop": (
        "elements:\n", "  one: {kind: rotation}\n  two: {kind: rotation}\nelements:\n"
        "  up:   {kind: gear, from: one, to: two, ratio: 2}\n"
        "  down: {kind: gear, from: two, to: one, ratio: 2}\n",
        12, "elements.down", "one and two follow one another in a loop",
    ),
    "node behind two gears": (
        "elements:\n", "  one: {kind: rotation}\n  two: {kind: rotation}\nelements:\n"
        "  up:   {kind: gear, from: one, to: two, ratio: 2}\n"
        "  down: {kind: gear, from: one, to: shaft, ratio: 2}\n",
        12, "elements.down", "follows two other nodes",
    ),
    "node without inertia and channel": (
        "elements:\n", "  idler: {kind: rotation}\nelements:\n"
        "  rub: {kind: friction, on: idler, coulomb: 1 N*m}\n",
        8, "nodes.idler", "no inertia, and no channel shows its motion",
    ),
    "unit of another dimension": (
        "0.69 cm^3/rev", "0.69 bar", 10, "elements.pump.displacement", "the wrong dimension",
    ),
    "unit that does not exist": (
        "0.69 cm^3/rev", "0.69 blah", 10, "elements.pump.displacement", "unknown unit 'blah'",
    ),
    "value outside what is possible": (
        "9e-4 kg*m^2", "-1 kg*m^2", 3, "nodes.shaft.inertia", "is outside 0",
    ),
    "value that is not a number": (
        "0.69 cm^3/rev", "true", 10, "elements.pump.displacement", "expected a number",
    ),
    "value that is not finite": (
        "0.69 cm^3/rev", ".nan", 10, "elements.pump.displacement", "not finite",
    ),
    "two names of one parameter": (
        "inputs:", "names: {x: pump.displacement, y: pump.displacement}\ninputs:", 16, "names.y",
        "'pump.displacement' has two names: x and y",
    ),
    "one name of two values": (
        "inputs:", "names: {x: [pump.displacement, leak.conductance]}\ninputs:", 16, "names.x",
        "share the name 'x', but not their value or unit",
    ),
    "name of a parameter that is not there": (
        "inputs:", "names: {x: pump.displacment}\ninputs:", 16, "names.x",
        "did you mean 'pump.displacement'",
    ),
    "name of nothing": ("inputs:", "names: {x: []}\ninputs:", 16, "names.x", "no parameter"),
    "name that is another parameter's": (
        "inputs:", "names: {leak.conductance: pump.displacement}\ninputs:", 16,
        "names.leak.conductance", "name of another parameter",
    ),
    "guess of a parameter that is not there": (
        "inputs:", "assumed: {pump.displ: a guess}\ninputs:", 16, "assumed.pump.displ",
        "did you mean 'pump.displacement'",
    ),
    "dead volumes without a stroke": (
        ", stroke: [-50 mm, 50 mm]", "", 7, "nodes.rod", "needs a stroke",
    ),
    "dead volume beside a volume": (
        "dead_volume_a: 10", "volume_a: 10", 12, "elements.cylinder.dead_volume_b",
        "does not go with",
    ),
    "stroke the wrong way round": (
        "[-50 mm, 50 mm]", "[50 mm, -50 mm]", 7, "nodes.rod.stroke", "the lower end comes first",
    ),
    "stroke of one end": ("[-50 mm, 50 mm]", "[50 mm]", 7, "nodes.rod.stroke", "two ends"),
    "stroke of a volume": (
        "chamber_a: {kind: volume", "chamber_a: {kind: volume, stroke: [0, 1]", 4,
        "nodes.chamber_a.stroke", "a volume has no 'stroke'",
    ),
    "input to a state": (
        "motor.current}", "shaft.speed}", 16, "inputs.current_command", "is a state",
    ),
    "input to an element that is not there": (
        "motor.current}", "moter.current}", 16, "inputs.current_command", "did you mean 'motor'",
    ),
    "input that the element does not have": (
        "motor.current}", "motor.torque}", 16, "inputs.current_command", "it has: current",
    ),
    "two inputs of one port": (
        "motor.current}", "motor.current, other: motor.current}", 16, "inputs.other",
        "both drive 'motor.current'",
    ),
    "unknown way between samples": (
        "motor.current}", "{to: motor.current, between_samples: held}}", 16,
        "inputs.current_command", "hold or linear",
    ),
    "name of a node and an element": (
        "  pump:  ", "  shaft:  ", 10, "elements.shaft", "names a node and an element",
    ),
    "name of the plant that is none": ("plant: axis", "plant: an axis", 1, "plant", "not a name"),
    "name with a dot": ("  shaft:  ", "  sha.ft:", 3, "nodes.sha.ft", "is not a name"),
    "servo without a motor": (
        "  seals:", SERVO.replace("motor: motor, ", "") + "  seals:", 13, "elements.loop",
        "needs 'motor'",
    ),
    "servo of what takes no command": (
        "  seals:", SERVO.replace("motor: motor", "motor: pump") + "  seals:", 13,
        "elements.loop.motor", "'pump' takes no command",
    ),
    "servo's gain in another command's unit": (
        "  seals:", SERVO.replace("A/rad", "V/rad") + "  seals:", 13, "elements.loop.proportional",
        "the wrong dimension",
    ),
    "two servos of one motor": (
        "  seals:", SERVO + SERVO.replace("loop", "second") + "  seals:", 14,
        "elements.second.motor", "both set the command of 'motor'",
    ),
    "gas of a cylinder that is not there": (
        "  seals:", GAS.replace("1 l}", "1 l, mid_stroke_of: cilinder}") + "  seals:", 13,
        "elements.gas.mid_stroke_of", "did you mean 'cylinder'",
    ),
    "gas of what is not a cylinder": (
        "  seals:", GAS.replace("1 l}", "1 l, mid_stroke_of: pump}") + "  seals:", 13,
        "elements.gas.mid_stroke_of", "is a pump, no cylinder",
    ),
}  # fmt: skip


def _load(path: Path, text: str) -> NetworkPlant:
    path.write_text(text, encoding="utf-8")
    return load_plant(path)


def test_a_plant_without_its_name_is_asked_for_it(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(PLANT.replace("plant: axis\n", ""))
    with pytest.raises(InputError, match="key 'plant' is missing; name the plant") as found:
        model_from(path)
    assert found.value.where is not None
    assert (found.value.where.file, found.value.where.line) == (str(path), 1)


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "way"),
    [
        ("channels: {", "foo: 1\nchannels: {", 17, "foo", "known: "),
        ("channels: {", "channel: {", 17, "channel", "did you mean 'channels'?"),
        ("elements:", "element:", 8, "element", "did you mean 'elements'?"),
    ],
)
def test_a_key_that_no_plant_has_is_named_where_a_model_is_read(
    tmp_path: Path, old: str, new: str, line: int, key: str, way: str
) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(PLANT.replace(old, new))
    with pytest.raises(InputError, match=f"unknown key '{key}'") as found:
        model_from(path)
    assert found.value.where == Place(str(path), line, key)
    assert found.value.hint.startswith(way)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistake_is_named_with_file_line_and_key(tmp_path: Path, mistake: str) -> None:
    old, new, line, key, sentence = MISTAKES[mistake]
    assert old in PLANT
    with pytest.raises(InputError) as found:
        _load(tmp_path / "plant.yaml", PLANT.replace(old, new, 1))
    where = found.value.where
    assert where is not None
    assert (Path(where.file).name, where.line, where.key) == ("plant.yaml", line, key)
    assert sentence in str(found.value)


@pytest.mark.parametrize("section", ["nodes", "elements", "channels"])
def test_section_that_is_missing_or_empty_is_named(tmp_path: Path, section: str) -> None:
    lines = PLANT.splitlines(keepends=True)
    first = next(k for k, line in enumerate(lines) if line.startswith(f"{section}:"))
    last = next(
        (k for k in range(first + 1, len(lines)) if not lines[k].startswith(" ")), len(lines)
    )
    for text, sentence in (("", "is missing"), (f"{section}: {{}}\n", "expected names")):
        with pytest.raises(InputError, match=sentence) as found:
            _load(tmp_path / "plant.yaml", "".join([*lines[:first], text, *lines[last:]]))
        assert section in str(found.value)


def test_the_plant_without_a_mistake_is_one(tmp_path: Path) -> None:
    plant = _load(tmp_path / "plant.yaml", PLANT)
    assert plant.inputs == ("current_command", "oil_temperature")
    assert plant.outputs == ("motor_speed", "pressure_a", "piston_position")
    assert plant.units["motor_speed"] == "rad/s"


def test_a_command_line_names_it_too(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                     monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    from eha_bench.cli.main import main

    (tmp_path / "plant.yaml").write_text(PLANT.replace("kind: pump", "kind: pomp"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["eha-bench", "validate", "plant.yaml"])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    message = capsys.readouterr().err
    assert "plant.yaml:10" in message
    assert "did you mean 'pump'" in message
    assert "Traceback" not in message


BRIDGE = """\
plant: servo
nodes:
  shaft: {kind: rotation, inertia: 1e-3 kg*m^2}
elements:
  motor: {kind: motor, on: shaft, resistance: 2 ohm, torque_constant: 0.1 N*m/A,
          supply_voltage: 24 V}
  loop:  {kind: position_servo, on: shaft, motor: motor, proportional: 6 1/rad}
inputs:   {goal: loop.reference}
channels: {angle: shaft.angle}
"""


def test_a_supply_that_nothing_drives_has_its_declared_voltage(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(BRIDGE)
    plant = load_plant(path)
    # the supply alone says that a bridge drives the motor
    assert "motor.duty" in plant.inputs
    assert plant.resting_inputs["motor.supply_voltage"] == 24.0
    assert plant.references == ("goal",)
