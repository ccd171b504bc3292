"""The page of terminal pictures shows every command, each picture once."""

import re
import sys

from pages import ROOT
from typer.main import get_command

from eha_bench.cli.app import app

sys.path.insert(0, str(ROOT / "docs" / "tools"))
import terminal


def test_every_command_is_shown_or_says_why_not() -> None:
    commands = set(get_command(app).commands)
    shown = {line.split()[1] for line in terminal.COMMANDS.values() if " " in line}
    assert shown | terminal.NOT_SHOWN == commands
    assert not shown & terminal.NOT_SHOWN


def test_the_page_has_each_picture_once() -> None:
    text = (ROOT / "docs" / "terminal.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"gallery/terminal/([\w-]+)\.svg", text)) == sorted(terminal.COMMANDS)
