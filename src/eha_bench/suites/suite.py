"""A suite: named trials, and the file they came from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from eha_bench.core.errors import InputError, Place
from eha_bench.core.near_miss import suggest
from eha_bench.core.trial import Trial
from eha_bench.core.yaml_file import line_of, named_file, parse


@dataclass(frozen=True)
class Suite:
    """What `load_suite` makes of a suite file.

    Attributes:
        name: safe as a file name.
        description: for people.
        trials: every combination of every matrix, in the order of the file.
        path: the file.
        text: its content, as it goes into recordings.
        sha256: digest of that content, hexadecimal.
        model: file name of the plant's model as written, relative to the suite; "" for none.
        controller: file name of the controller as written, relative to the suite; "" for none.
        target: name or file of the target as written; "" for none.
    """

    name: str
    description: str
    trials: tuple[Trial, ...]
    path: Path
    text: str
    sha256: str
    model: str = ""
    controller: str = ""
    target: str = ""

    def file(self, key: str) -> Path | None:
        """Return the file that `model`, `controller` or `target` names; None where it names none.

        Raises:
            InputError: there is no such file; with file, line and key.
        """
        name = {"model": self.model, "controller": self.controller, "target": self.target}[key]
        if not name or name == "simulator":
            return None
        path = self.path.parent / name
        if path.is_file():
            return path
        # a suite is parsed again for the line only where that has to be reported
        line = line_of(parse(self.text, str(self.path)), [key])
        return named_file(self.path.parent, name, Place(str(self.path), line, key))

    def trial(self, name: str) -> Trial:
        """Return the trial with this id.

        Raises:
            InputError: the suite has none of that name.
        """
        for trial in self.trials:
            if trial.id == name:
                return trial
        raise InputError(
            f"no trial '{name}' in suite '{self.name}'",
            where=Place(file=str(self.path)),
            hint=suggest(name, [trial.id for trial in self.trials]),
        )
