"""The drive's side of its control words and states, as the target file describes them."""

from __future__ import annotations

from eha_bench.targets.can.drive import CanDrive


class DriveStates:
    """The state machine: `off`, the states on the way to `enabled`, and `fault`.

    A step's word takes the drive into the step's state if it is at least in the state before it;
    the disable word takes it off from anywhere but fault; only the reset word leaves fault.

    Attributes:
        state: name of the state now.
    """

    def __init__(self, drive: CanDrive) -> None:
        self._word = drive.file.control_word
        self._order = [step.state for step in self._word.enable]
        self.state = "off"

    @property
    def enabled(self) -> bool:
        """Whether torque may be on."""
        return self.state == "enabled"

    @property
    def watched(self) -> bool:
        """Whether commands have to keep coming: from the first step of enabling on."""
        return self.state in self._order

    def take(self, word: int) -> None:
        """Change state as a control word asks."""
        if self.state == "fault":
            if word == self._word.reset:
                self.state = "off"
            return
        reached = self._order.index(self.state) if self.state in self._order else -1
        for number, step in enumerate(self._word.enable):
            if word == step.word:
                if number <= reached + 1:
                    self.state = step.state
                return
        self.state = "off"  # disable, reset, or an unknown word

    def fail(self) -> None:
        """Go into fault."""
        self.state = "fault"
