"""Radial and angular statistics against closed forms and brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import disc, star, star_radius, wheel

from yeastfit.measure.statistics.filaments import Filaments
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.spatial_indices import (
    angular_index,
    angular_pair_correlation,
    angular_spectrum,
    dominant_wave_number,
    radial_index,
    radial_profile,
)

angles = st.lists(st.floats(-np.pi, np.pi), min_size=2, max_size=60).map(np.array)


def test_a_disc_has_no_outer_region_and_no_direction():
    """Less than as many pixels in random directions, p_k = 1 / N on average."""
    for radius in (30, 100.4):
        pixels = Pixels.of(disc(radius))
        assert 0 <= radial_index(pixels.distance) < 0.03
        assert angular_index(pixels.angle) < 0.01
        assert angular_spectrum(pixels.angle)[1:25].max() < 1 / len(pixels.angle)


def test_radial_index_of_a_core_with_filaments():
    """The core's edge within one ring of 1/50 of the area of the largest disc."""
    core, reach = 60.0, 150.0
    found = reach * (1 - radial_index(Pixels.of(wheel(core, 7, reach, 5)).distance))
    assert core - reach**2 / 50 / core / 2 <= found <= core + reach**2 / 50 / core / 2


def test_angular_index_between_its_limits():
    assert angular_index(np.full(9, 0.7)) == pytest.approx(1)
    even = (np.arange(4800) + 0.5) * (2 * np.pi / 4800) - np.pi
    assert angular_index(even) == pytest.approx(0, abs=1e-12)
    assert angular_index(np.concatenate([np.full(10, 0.0), np.full(10, 2.0)])) == pytest.approx(np.sqrt(23 / 47))
    assert np.isnan(angular_index(np.empty(0)))


@settings(deadline=None)
@given(angles)
def test_pair_correlation_counts_pairs(angle):
    """Of sectors of 1°, over all ordered pairs of different pixels; 1 on average over the circle."""
    separations, g = angular_pair_correlation(angle)
    sector = np.rint(np.degrees(angle)).astype(int) % 360
    apart = (sector[:, None] - sector[None, :])[~np.eye(len(angle), dtype=bool)] % 360
    number = len(angle) * (len(angle) - 1)
    np.testing.assert_allclose(g, 360 * np.bincount(apart, minlength=360)[:181] / number, atol=1e-9)
    np.testing.assert_allclose(np.degrees(separations), np.arange(181))
    assert (g[0] + 2 * g[1:180].sum() + g[180]) / 360 == pytest.approx(1)


@settings(deadline=None)
@given(angles)
def test_pair_correlation_and_spectrum_are_transforms_of_each_other(angle):
    number = len(angle)
    g = angular_pair_correlation(angle)[1] * (number - 1) / number
    g[0] += 360 / number
    even = np.concatenate([g, g[-2:0:-1]]) / 360
    np.testing.assert_allclose(angular_spectrum(angle), np.fft.rfft(even).real, atol=1e-9)


def test_fewer_than_two_pixels_have_no_pairs():
    assert np.isnan(angular_pair_correlation(np.zeros(1))[1]).all()
    assert np.isnan(angular_spectrum(np.empty(0))).all()
    assert np.isnan(dominant_wave_number(angular_spectrum(np.empty(0))))
    assert np.isnan(dominant_wave_number(np.array([1.0, 0.0, 0.0])))
    assert dominant_wave_number(np.array([1.0, 0.1, 0.2, 0.3]), 2.9) == 2
    assert np.isnan(dominant_wave_number(np.array([1.0, 0.1, 0.2, 0.3]), 0.5))


@pytest.mark.parametrize("arms", [3, 5, 8, 13, 40])
def test_the_dominant_wave_number_counts_arms(arms):
    filaments = Filaments(Pixels.of(star(150, 0.3, arms)))
    assert dominant_wave_number(angular_spectrum(filaments.angle)) == arms
    separations, g = angular_pair_correlation(filaments.angle)
    first_peak = np.degrees(separations)[np.argmax(np.where(separations > np.pi / arms, g, 0))]
    assert first_peak % (360 / arms) == pytest.approx(0, abs=1.5) or -first_peak % (360 / arms) < 1.5


def test_powers_of_a_star_by_quadrature():
    """Beyond a circle, of the density ½ max(0, r(θ)² − r_A²)."""
    radius, amplitude, arms = 200.0, 0.25, 6
    pixels = Pixels.of(star(radius, amplitude, arms))
    angle = np.linspace(0, 2 * np.pi, 7201)[:-1]
    density = np.maximum(star_radius(angle, radius, amplitude, arms) ** 2 - radius**2, 0)
    power = angular_spectrum(pixels.angle[pixels.distance >= radius])
    for k in (arms, 2 * arms, 3 * arms):
        exact = ((density * np.cos(k * angle)).sum() / density.sum()) ** 2
        assert power[k] == pytest.approx(exact, rel=0.03, abs=2e-4)
    assert np.delete(power[1:25], [arms - 1, 2 * arms - 1, 3 * arms - 1, 4 * arms - 1]).max() < 1e-4


def test_profile_of_a_disc_and_its_area():
    """1 inside, 0 outside, and all pixels are somewhere."""
    pixels, width, count = Pixels.of(disc(60)), 6.0, 13
    found = radial_profile(pixels.distance, width, count)
    np.testing.assert_allclose(found[1:10], 1, atol=0.02)
    assert found[0] == pytest.approx(1, abs=0.1)
    assert found[12] == 0
    ring = 2 * np.pi * width**2 * np.arange(count)
    ring[0] = np.pi * width**2 / 3
    assert (found * ring).sum() == pytest.approx(pixels.area)
