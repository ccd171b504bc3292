"""The knee's geometry against the published figures and its own derivative."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.linkage import Linkage

KNEE = Linkage(a=0.3208, b=0.0462, c0=0.280, half_stroke=0.040)
STROKE = st.floats(-0.039, 0.039)


def test_the_published_range_of_the_knee_is_symmetric_about_mid_stroke() -> None:
    # paper notes: 50 to 120 degrees absolute is a rod from -26.8 to +26.2 mm
    assert KNEE.position_at(math.radians(50)) == pytest.approx(-26.8e-3, abs=0.06e-3)
    assert KNEE.position_at(math.radians(120)) == pytest.approx(26.2e-3, abs=0.06e-3)


@given(STROKE)
def test_angle_and_position_are_inverse(position: float) -> None:
    assert KNEE.position_at(KNEE.angle_at(position)) == pytest.approx(position, abs=1e-12)
    assert KNEE.angle(np.array([position]))[0] == pytest.approx(KNEE.angle_at(position))


@given(STROKE)
def test_the_moment_arm_is_the_derivative_of_length_by_angle(position: float) -> None:
    step = 1e-6
    slope = 2 * step / (KNEE.angle_at(position + step) - KNEE.angle_at(position - step))
    assert KNEE.arm(np.array([position]))[0] == pytest.approx(slope, rel=1e-6)


def test_a_triangle_that_does_not_close_has_no_angle() -> None:
    assert math.isnan(KNEE.angle_at(1.0))
    assert np.isnan(KNEE.angle(np.array([1.0])))[0]
