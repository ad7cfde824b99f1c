"""The last digit of numbers, recognised from the numbers."""

from __future__ import annotations

import numpy as np
import pytest

from deltac.arrays import medians
from deltac.diagnosis.measurements.digits import Digits, resolution

RNG = np.random.default_rng(1)
VALUES = RNG.normal(size=1000) * 10.0 ** RNG.integers(-3, 3, size=1000)


@pytest.mark.parametrize("decimals", [2, 6, 9])
def test_fixed_decimals(decimals: int) -> None:
    half = resolution(VALUES.round(decimals)[:, None])
    np.testing.assert_allclose(half, 0.5 * 10.0**-decimals)
    assert np.all(np.abs(VALUES.round(decimals) - VALUES) <= half[:, 0] * (1 + 1e-6))


@pytest.mark.parametrize("digits", [4, 7, 10])
def test_significant_digits(digits: int) -> None:
    written = np.array([float(f"{x:.{digits - 1}e}") for x in VALUES])
    half = resolution(written[:, None])[:, 0]
    assert np.all(np.abs(written - VALUES) <= half * (1 + 1e-6))
    assert np.all(half <= 5.0 * 10.0**-digits * np.abs(written) * (1 + 1e-9))


def test_single_and_double_precision() -> None:
    single = VALUES.astype(np.float32).astype(float)
    half = resolution(np.column_stack([single, VALUES]))
    assert np.all(np.abs(single - VALUES) <= half[:, 0])
    np.testing.assert_array_equal(half[:, 1], np.finfo(float).eps * np.abs(VALUES))


def test_zeros_and_constants_have_no_error_to_speak_of() -> None:
    half = resolution(np.column_stack([np.zeros(50), np.full(50, 0.25)]))
    assert np.all(half[:, 0] == 0.0)
    assert np.all(half[:, 1] <= 1e-15)


def test_half_precision_is_not_taken_for_decimals() -> None:
    """Numbers of ten bits have few decimals, which are no sign of their exactness."""
    half = resolution(VALUES.astype(np.float16).astype(float)[:, None])[:, 0]
    assert np.all(np.abs(VALUES.astype(np.float16) - VALUES) <= half)


def test_a_column_that_hardly_changes_is_written_as_the_others() -> None:
    """Two numbers alone do not tell how they were rounded; those beside them do."""
    written = VALUES.astype(np.float16).astype(float)
    steady = np.where(np.arange(1000) < 400, 1.1640625, 1.16308594)  # neighbours in half precision
    steady = steady.astype(np.float16).astype(float)
    half = resolution(np.column_stack([written, steady, 0.0 * steady]))
    np.testing.assert_array_equal(half[:, 1], 0.5 * np.spacing(np.float16(1.1640625)))
    assert not half[:, 2].any()
    alone = resolution(np.column_stack([VALUES, steady]))
    assert np.all(alone[:, 1] <= np.finfo(float).eps * steady)


def test_a_number_beyond_half_precision_between_the_probes_has_a_last_digit() -> None:
    column = np.tile(np.arange(8.0) / 3.0, 500).astype(np.float16).astype(float)[:, None]
    expected = resolution(column)
    column[1] = 1e6
    assert np.isfinite(resolution(column)).all()
    np.testing.assert_array_equal(np.delete(resolution(column), 1), np.delete(expected, 1))


def test_a_log_that_begins_at_rest_has_the_digits_of_its_motion() -> None:
    column = np.concatenate([np.zeros(1000), VALUES.astype(np.float32)])[:, None]
    assert Digits(column).few
    assert not Digits(np.concatenate([np.zeros(1000), VALUES])[:, None]).few


def test_counts_of_an_encoder() -> None:
    count = 2.0 * np.pi / 4096
    angle = np.sin(np.linspace(0.0, 6.0, 4000))
    np.testing.assert_allclose(resolution(np.rint(angle / count)[:, None] * count), 0.5 * count)
    assert np.all(resolution(np.linspace(0.0, 1.0, 4000)[:, None]) < 1e-12)  # evenly, but no counts


@pytest.mark.parametrize("count", [5, 6])
def test_medians(count: int) -> None:
    values = RNG.normal(size=(3, 4, count))
    values[1, 2, 3] = np.nan
    np.testing.assert_array_equal(medians(values), np.median(values, axis=-1))
