"""The adapter's side of slcan, the ASCII protocol of Lawicel and CANable adapters.

Frames are `tIIILDD..` (11-bit identifier) and `TIIIIIIIILDD..` (29-bit), every line ends with a
carriage return; `O` opens the channel, `C` closes it, `S0`-`S8` set the bit rate (Lawicel CAN232
manual, version 3).
"""

from __future__ import annotations

from eha_bench.targets.can.drive import Frame

_OK, _BELL = b"\r", b"\a"
_LONGEST = 64
_ANSWERS = {b"V": b"V1013\r", b"N": b"NEHA1\r", b"F": b"F00\r"}
_ACCEPTED = frozenset(b"OLCSsYZMmXW")


class Adapter:
    """Turns bytes from the host into frames, and frames into bytes for it.

    Attributes:
        open: whether the host has opened the channel; no frame passes while it is closed.
    """

    def __init__(self) -> None:
        self.open = False
        self._rest = b""

    def feed(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Return the frames that the host sends, and what the adapter answers it."""
        lines = (self._rest + data).split(b"\r")
        self._rest = lines.pop()[-_LONGEST:]
        frames, answers = [], []
        for line in lines:
            kind = line[:1]
            if kind in (b"t", b"T"):
                frame = _parsed(line) if self.open else None
                if frame is not None:
                    frames.append(frame)
                answers.append((b"z\r" if kind == b"t" else b"Z\r") if frame else _BELL)
            elif kind in _ANSWERS:
                answers.append(_ANSWERS[kind])
            elif not line or line[0] in _ACCEPTED:
                if kind in (b"O", b"L"):
                    self.open = True
                elif kind == b"C":
                    self.open = False
                answers.append(_OK)
            else:
                answers.append(_BELL)
        return frames, b"".join(answers)


def frame_as_text(frame: Frame) -> bytes:
    """Return a frame as the adapter passes it on."""
    if frame.extended:
        head = b"T%08X%d" % (frame.id, len(frame.data))
    else:
        head = b"t%03X%d" % (frame.id, len(frame.data))
    return head + frame.data.hex().upper().encode() + _OK


def _parsed(line: bytes) -> Frame | None:
    digits = 8 if line[:1] == b"T" else 3
    try:
        identifier = int(line[1 : 1 + digits], 16)
        length = int(line[1 + digits : 2 + digits])
        data = bytes.fromhex(line[2 + digits : 2 + digits + 2 * length].decode("ascii"))
    except ValueError:
        return None
    if len(data) != length or length > 8 or len(line) != 2 + digits + 2 * length:
        return None
    return Frame(identifier, data, digits == 8)
