"""What somebody's code raises becomes one line that a person can read."""

import pytest

from eha_bench.core.error_text import error_text


def test_pages_in_colours_become_one_short_plain_line() -> None:
    """As Numba raises them: thousands of characters with the terminal's colours."""
    pages = "\x1b[1mCannot determine the type\x1b[0m of <f>\n" + "during: typing of call\n" * 300
    with pytest.raises(TypeError) as caught:
        raise TypeError(pages)
    text = error_text(caught.value)
    assert text.startswith("TypeError: Cannot determine the type of <f> during: ")
    assert len(text) < 700
    assert text.isprintable()
    assert "test_crash.py" in text  # where it was raised stands behind it
