"""The distributed model against shafts with an answer in closed form, and the lumped forms against it."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from ballscrew.axis import compliance
from ballscrew.axis.frequency import axial_natural_frequency, predicted_frequency
from ballscrew.axis.hertz import apparent_preload
from ballscrew.axis.model import rotor_mass
from ballscrew.axis.rod import _matrices, _nodes, rod_frequency, rod_modes
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError

TAU = 2 * np.pi
GHOST = 1e-9  # kg: a table that nobody feels
RIGID = 1e14  # N/m: a nut or a bearing that does not give
lumped_frequency = partial(axial_natural_frequency, torsion=True)


def coupled(sheet, stiffness=5000.0):
    return replace(sheet, drive=replace(sheet.drive, coupling_stiffness=stiffness))


def changed(sheet, **fields):
    """The sheet with ``screw__lead=…`` and the like."""
    for path, value in fields.items():
        part, _, name = path.partition("__")
        sheet = replace(sheet, **{part: replace(getattr(sheet, part), **{name: value}) if name else value})
    return sheet


def bare(sheet, **fields):
    """The shaft alone, on a bearing that does not give."""
    return changed(sheet, table__mass=GHOST, bearing__stiffness=RIGID, **fields)


def stiff(sheet, **fields):
    """A shaft without weight that does not give."""
    return changed(
        sheet, screw__density=1e-6, screw__youngs_modulus=1e18, screw__shear_modulus=1e18, **fields
    )


def stretching(sheet):
    """c of axial waves, m/s."""
    return np.sqrt(sheet.screw.youngs_modulus / sheet.screw.density)


def twisting(sheet):
    """c of torsional waves, m/s: the root diameter springs, the nominal one turns."""
    screw = sheet.screw
    return np.sqrt(screw.shear_modulus / screw.density) * (screw.root_diameter / screw.nominal_diameter) ** 2


# The shaft alone: with no table the nut carries nothing, so stretching and twisting do not meet.


@pytest.mark.parametrize("rotor", ["free", "held"])
def test_a_shaft_fixed_at_one_end_rings_at_a_quarter_wave(axes, rotor):
    sheet = bare(axes["M"], screw__shear_modulus=1e15)
    got = rod_modes(sheet, 0.2, 0.0, rotor=rotor, nut_rigidity=RIGID, count=2).frequencies[:2]
    quarter = stretching(sheet) / (4 * 0.9)
    np.testing.assert_allclose(got, [quarter, 3 * quarter], rtol=1e-4)


def test_a_shaft_fixed_at_both_ends_rings_at_a_half_wave(axes):
    sheet = bare(axes["M"], screw__shear_modulus=1e15, support="fixed-fixed")
    got = rod_modes(sheet, 0.2, 0.0, rotor="held", nut_rigidity=RIGID, count=2).frequencies[:2]
    np.testing.assert_allclose(got, stretching(sheet) / (2 * 0.9) * np.array([1, 2]), rtol=1e-4)


def test_a_shaft_whose_rotor_is_held_twists_at_a_quarter_wave(axes):
    sheet = bare(axes["M"], screw__youngs_modulus=1e16)
    got = rod_modes(sheet, 0.2, 0.0, rotor="held", nut_rigidity=RIGID, count=2).frequencies[:2]
    quarter = twisting(sheet) / (4 * 0.9)
    np.testing.assert_allclose(got, [quarter, 3 * quarter], rtol=1e-4)


def test_a_shaft_twists_on_the_coupling(axes):
    # (ωL/c) tan(ωL/c) = K L / (G I_p).
    sheet = bare(coupled(axes["M"]), screw__youngs_modulus=1e16)
    screw = sheet.screw
    ratio = 5000 * screw.length / (screw.shear_modulus * np.pi * screw.root_diameter**4 / 32)
    root = brentq(lambda z: z * np.tan(z) - ratio, 1e-6, np.pi / 2 - 1e-9)
    got = rod_modes(sheet, 0.2, 0.0, rotor="held", nut_rigidity=RIGID).frequencies[0]
    assert got == pytest.approx(root * twisting(sheet) / (TAU * 0.9), rel=1e-4)


def test_a_shaft_twists_against_a_free_rotor(axes):
    # tan(ωL/c) = −(J_rotor / J_screw) ωL/c.
    sheet = bare(axes["M"], screw__youngs_modulus=1e16)
    ratio = sheet.drive.rotor_inertia / compliance.screw_inertia(0.025, 0.9, 7850)
    root = brentq(lambda z: np.tan(z) + ratio * z, np.pi / 2 + 1e-9, np.pi)
    got = rod_modes(sheet, 0.2, 0.0, rotor="free", nut_rigidity=RIGID).frequencies[0]
    assert got == pytest.approx(root * twisting(sheet) / (TAU * 0.9), rel=1e-4)


@pytest.mark.parametrize("table", [0.5, 3.0, 100.0])
def test_a_shaft_with_a_mass_at_its_end(axes, table):
    # (ωL/c) tan(ωL/c) = m_screw / m_table.
    sheet = changed(axes["M"], screw__shear_modulus=1e15, bearing__stiffness=RIGID, table__mass=table)
    ratio = compliance.screw_mass(0.0214, 0.9, 7850) / table
    root = brentq(lambda z: z * np.tan(z) - ratio, 1e-6, np.pi / 2 - 1e-9)
    got = rod_frequency(sheet, sheet.travel_limit, 0.0, rotor="held", nut_rigidity=RIGID)
    assert float(got) == pytest.approx(root * stretching(sheet) / (TAU * 0.9), rel=1e-4)


# A shaft without weight: two masses and springs in series.


def test_two_masses_on_the_nut(axes):
    sheet = stiff(axes["M"], bearing__stiffness=1e17)
    nut, table, rotor = 2e8, 131.5, 3e-4 / (0.01 / TAU) ** 2
    held = rod_frequency(sheet, 0.1, 30.0, rotor="held", nut_rigidity=nut)
    assert float(held) == pytest.approx(np.sqrt(nut / table) / TAU, rel=1e-5)
    free = rod_frequency(sheet, 0.1, 30.0, rotor="free", nut_rigidity=nut)
    assert float(free) == pytest.approx(np.sqrt(nut * (1 / table + 1 / rotor)) / TAU, rel=1e-5)


@pytest.mark.parametrize("support", ["fixed-free", "fixed-supported", "fixed-fixed"])
@pytest.mark.parametrize("rotor", ["free", "held"])
@pytest.mark.parametrize("name", ["S", "M", "L"])
def test_the_lumped_form_is_the_limit_of_a_light_screw(axes, name, rotor, support):
    sheet = changed(coupled(axes[name]), screw__density=1e-3, support=support)
    lumped = lumped_frequency(sheet, 0.2, 30.0, 300.0, rotor)
    assert float(rod_frequency(sheet, 0.2, 30.0, 300.0, rotor)) == pytest.approx(float(lumped), rel=1e-5)


# The whole axis, exactly: waves on both sides of the nut instead of elements.


def exact(sheet, position, load, rotor, guess):
    """The root next to ``guess`` (Hz) of 1/(m ω²) = 1/k_nut + receptance in tension + in torsion."""
    screw, drive = sheet.screw, sheet.drive
    beta = compliance.transmission_ratio(screw.lead)
    d = screw.bearing_to_zero + position
    rest = screw.length - d
    nut = compliance.nut_rigidity(
        sheet.nominal_preload, screw.rigidity, screw.dynamic_load_rating, screw.rigidity_preload_ratio
    )
    pull = screw.youngs_modulus * np.pi * screw.root_diameter**2 / 4
    turn = screw.shear_modulus * np.pi * screw.root_diameter**4 / 32 / beta**2
    far = sheet.bearing.stiffness if sheet.support == "fixed-fixed" else 0.0

    def side(rigidity, q, length, end):
        """Dynamic stiffness of a length of shaft that ends on the stiffness ``end``."""
        wave, t = rigidity * q, np.tan(q * length)
        return wave if end == np.inf and length == 0 else _over(wave, t, end)

    def residual(f):
        w = TAU * f
        own = -drive.rotor_inertia / beta**2 * w**2 if rotor == "free" else np.inf
        if drive.coupling_stiffness is not None:
            own = 1 / (beta**2 / drive.coupling_stiffness + 1 / own)
        q, p = w / stretching(sheet), w / twisting(sheet)
        axial = side(pull, q, d, sheet.bearing.stiffness) + side(pull, q, rest, far)
        twist = side(turn, p, d, own) + side(turn, p, rest, 0.0)
        return 1 / nut + 1 / axial + 1 / twist - 1 / ((sheet.table.mass + load) * w**2)

    return brentq(residual, guess * 0.99, guess * 1.01, xtol=1e-9)


def _over(wave, t, end):
    if end == np.inf:
        return wave / t
    return wave * (end - wave * t) / (wave + end * t)


@pytest.mark.parametrize("support", ["fixed-free", "fixed-fixed"])
@pytest.mark.parametrize("rotor", ["free", "held"])
@pytest.mark.parametrize("coupling", [None, 5000.0])
@pytest.mark.parametrize("name", ["S", "M", "L"])
def test_it_agrees_with_waves_on_a_continuous_shaft(axes, name, coupling, rotor, support):
    sheet = changed(coupled(axes[name], coupling), support=support)
    for x, load in ((0.0, 0.0), (0.3, 50.0)):
        got = float(rod_frequency(sheet, x, load, rotor=rotor))
        assert got == pytest.approx(exact(sheet, x, load, rotor, got), rel=2e-5)


@pytest.mark.parametrize("rotor", ["free", "held"])
def test_the_error_falls_with_the_square_of_the_elements_and_never_below_the_truth(axes, rotor):
    sheet = coupled(axes["L"])
    middle = sheet.screw.length / 2 - sheet.screw.bearing_to_zero
    error = [
        float(rod_frequency(sheet, middle, 0.0, rotor=rotor, elements=n)) for n in (4, 8, 16, 32, 64)
    ] - np.float64(exact(sheet, middle, 0.0, rotor, float(rod_frequency(sheet, middle, 0.0, rotor=rotor))))
    assert np.all(error > 0)
    np.testing.assert_allclose(np.log2(error[:-1] / error[1:]), 2, atol=0.05)


# The three axes.


@pytest.mark.parametrize(
    ("name", "free", "held"), [("S", 333.15, 309.53), ("M", 178.35, 145.49), ("L", 177.33, 136.68)]
)
def test_the_three_axes(axes, name, free, held):
    sheet = coupled(axes[name])
    assert float(rod_frequency(sheet, 0.0, 0.0)) == pytest.approx(free, abs=0.01)
    assert float(rod_frequency(sheet, 0.0, 0.0, rotor="held")) == pytest.approx(held, abs=0.01)


# Another program's model of the same axes, to the whole hertz.
@pytest.mark.parametrize(("name", "free", "held"), [("S", 333, 309), ("M", 178, 145), ("L", 177, 137)])
def test_the_three_axes_elsewhere(axes, name, free, held):
    sheet = coupled(axes[name])
    assert float(rod_frequency(sheet, 0.0, 0.0)) == pytest.approx(free, rel=0.01)
    assert float(rod_frequency(sheet, 0.0, 0.0, rotor="held")) == pytest.approx(held, rel=0.01)


def test_on_the_large_lead_the_first_torsional_mode_takes_part(axes):
    for name, frequency, share in (("S", 1178, 0.0), ("M", 650, 0.0), ("L", 309, 0.058)):
        modes = rod_modes(coupled(axes[name]), 0.0, 0.0)
        assert modes.frequencies[1] == pytest.approx(frequency, abs=0.6)
        assert modes.table_share[1] == pytest.approx(share, abs=0.001)


def test_without_the_inertia_of_the_screw_behind_the_coupling_the_lumped_form_is_right(axes):
    # What the lumped form misses on the large lead: the screw turns between the coupling and the nut.
    sheet = coupled(axes["L"])
    moved = sheet.drive.rotor_inertia + compliance.screw_inertia(0.040, 1.10, 7850)
    light = changed(sheet, screw__nominal_diameter=1e-3, drive__rotor_inertia=moved)
    assert float(rod_frequency(light, 0.0, 0.0)) == pytest.approx(
        float(lumped_frequency(sheet, 0.0, 0.0)), rel=0.005
    )


@pytest.mark.parametrize("rotating", ["screw", "nut"])
@pytest.mark.parametrize("support", ["fixed-free", "fixed-supported", "fixed-fixed"])
@pytest.mark.parametrize("rotor", ["free", "held"])
@pytest.mark.parametrize("name", ["S", "M", "L"])
def test_the_prediction_is_that_of_the_elements_from_end_to_end(axes, name, rotor, support, rotating):
    sheet = changed(coupled(axes[name]), support=support, drive__rotating=rotating, drive__ratio=1.5)
    x = np.array([-sheet.screw.bearing_to_zero, 0.2, sheet.travel_limit])
    elements = rod_frequency(sheet, x, 30.0, 300.0, rotor)
    np.testing.assert_allclose(predicted_frequency(sheet, x, 30.0, 300.0, rotor), elements, rtol=3e-6)


def test_the_prediction_follows_the_two_bearings_a_rigid_coupling_and_the_nut_load(axes):
    sheet = changed(axes["M"], support="fixed-fixed", bearing__far_stiffness=60e6)
    assert float(predicted_frequency(sheet, 0.3, 5.0)) == pytest.approx(
        float(rod_frequency(sheet, 0.3, 5.0)), rel=3e-6
    )
    loaded = rod_frequency(sheet, 0.3, 5.0, float(apparent_preload(800.0, sheet.nominal_preload)))
    assert float(predicted_frequency(sheet, 0.3, 5.0, nut_load=800.0)) == pytest.approx(
        float(loaded), rel=3e-6
    )


# Which mode is called axial.


def test_the_axial_mode_is_the_first_of_an_ordinary_axis(axes):
    for sheet in axes.values():
        for rotor in ("free", "held"):
            for axis in (sheet, coupled(sheet)):
                modes = rod_modes(axis, 0.0, 0.0, rotor=rotor)
                assert modes.first_axial == 0
                assert modes.axial_frequency == modes.frequencies[0]


def test_the_twist_of_a_long_thin_screw_is_not_taken_for_the_axial_mode(axes):
    sheet = changed(axes["S"], screw__length=3.0)
    modes = rod_modes(sheet, 0.0, 0.0, rotor="held")
    assert modes.frequencies[0] == pytest.approx(twisting(sheet) / 12, rel=0.01)
    assert modes.first_axial == 1
    lumped = float(lumped_frequency(sheet, 0.0, 0.0, rotor="held"))
    assert modes.axial_frequency == pytest.approx(lumped, rel=0.05)
    # It is found, and comes back, even if fewer modes were asked for.
    predicted = float(predicted_frequency(sheet, 0.0, 0.0, rotor="held"))
    assert predicted == pytest.approx(modes.axial_frequency, rel=1e-5)
    few = rod_modes(sheet, 0.0, 0.0, rotor="held", count=1)
    assert few.axial_frequency == modes.axial_frequency
    assert few.frequencies.shape == few.table.shape == (2,)


# Shapes.


@pytest.mark.parametrize("coupling", [None, 5000.0])
@pytest.mark.parametrize("rotor", ["free", "held"])
def test_shapes_are_orthogonal_and_give_back_their_frequencies(axes, coupling, rotor):
    sheet = coupled(axes["L"], coupling)
    modes = rod_modes(sheet, 0.1, 20.0, rotor=rotor, elements=40, count=8)
    nodes, at_nut = _nodes(1.10, 0.25, 40)
    np.testing.assert_array_equal(nodes, modes.nodes)
    screw = sheet.screw
    nut = compliance.nut_rigidity(1600.0, screw.rigidity, screw.dynamic_load_rating, 0.1)
    stiffness, mass = _matrices(sheet, nodes, at_nut, float(nut), 20.0)
    twist = modes.twist[:, 1:] if coupling is None else modes.twist
    shapes = np.column_stack([modes.axial, modes.table, twist, modes.rotor])
    np.testing.assert_allclose(shapes @ mass @ shapes.T, np.eye(8), atol=1e-9)
    energy = np.diag((TAU * modes.frequencies) ** 2)
    np.testing.assert_allclose(shapes @ stiffness @ shapes.T, energy, atol=1e-6 * energy.max())
    assert np.all(modes.table > 0)
    if coupling is None:
        np.testing.assert_array_equal(modes.twist[:, 0], modes.rotor)
    if rotor == "held":
        np.testing.assert_array_equal(modes.rotor, 0)


def test_the_nut_has_a_node_of_its_own(axes):
    for x in (-0.12, -0.0321, 0.0, 0.4567, 0.78):
        nodes = rod_modes(axes["M"], x, 0.0, elements=30).nodes
        assert np.min(np.abs(nodes - (0.12 + x))) < 1e-12
        assert nodes.shape == (31,)
        assert (nodes[0], nodes[-1]) == (0.0, 0.9)
        assert np.all(np.diff(nodes) > 0)


@pytest.mark.parametrize("coupling", [None, 5000.0])
def test_a_free_rotor_moves_the_whole_axis_at_no_force(axes, coupling):
    sheet = coupled(axes["M"], coupling)
    stiffness, _ = _matrices(sheet, *_nodes(0.9, 0.3, 20), 2e8, 50.0)
    n = 21
    rigid = np.concatenate([np.zeros(n), np.ones(len(stiffness) - n)])
    np.testing.assert_allclose(stiffness @ rigid / np.abs(stiffness).max(), 0, atol=1e-13)
    modes = rod_modes(sheet, 0.18, 50.0, elements=20, count=20)
    assert modes.equivalent_mass == pytest.approx(101.5 + 50 + rotor_mass(sheet), rel=1e-9)
    assert modes.frequencies[0] > 100
    assert rod_modes(sheet, 0.18, 50.0, rotor="held").equivalent_mass == np.inf
    # With the rigid body's share the table's are all of the table.
    assert modes.table_share.sum() + 151.5 / modes.equivalent_mass == pytest.approx(1, abs=1e-3)


# What must rise and fall.


@pytest.mark.parametrize("coupling", [None, 5000.0])
def test_the_modes_with_the_rotor_held_lie_between_those_with_it_free(axes, coupling):
    for sheet in axes.values():
        free = rod_modes(coupled(sheet, coupling), 0.1, 10.0, count=6).frequencies
        held = rod_modes(coupled(sheet, coupling), 0.1, 10.0, rotor="held", count=7).frequencies
        assert np.all(held[:6] < free)
        assert np.all(free < held[1:])


def test_a_heavy_rotor_acts_as_a_fixed_one(axes):
    for sheet in axes.values():
        heavy = changed(coupled(sheet), drive__rotor_inertia=1e5)
        free = rod_modes(heavy, 0.1, 10.0).frequencies
        held = rod_modes(heavy, 0.1, 10.0, rotor="held").frequencies
        np.testing.assert_allclose(free, held, rtol=1e-6)


few = settings(max_examples=20, deadline=None)


@few
@given(
    x=st.floats(-0.1, 0.75),
    load=st.floats(0, 200),
    force=st.floats(5, 2000),
    rotor=st.sampled_from(["free", "held"]),
    support=st.sampled_from(["fixed-free", "fixed-supported", "fixed-fixed"]),
)
def test_preload_raises_it_and_load_lowers_it(axes, x, load, force, rotor, support):
    sheet = changed(coupled(axes["M"]), support=support)
    here, tighter, heavier = rod_frequency(
        sheet, x, [load, load, load + 1], [force, 1.1 * force, force], rotor, elements=20
    )
    assert heavier < here < tighter


@few
@given(x=st.floats(-0.1, 0.74), rotor=st.sampled_from(["free", "held"]))
def test_it_falls_with_the_distance_from_the_only_bearing(axes, x, rotor):
    here, further = rod_frequency(coupled(axes["M"]), [x, x + 0.02], 0.0, rotor=rotor, elements=60)
    assert further < here


@few
@given(distance=st.floats(0, 0.45), load=st.floats(0, 100))
def test_between_two_bearings_it_is_the_same_from_either_end_and_softest_in_the_middle(axes, distance, load):
    sheet = changed(axes["M"], support="fixed-fixed", screw__shear_modulus=1e17)
    x = np.array([distance, 0.9 - distance, 0.45]) - 0.12
    one, other, middle = rod_frequency(sheet, x, load, rotor="held", elements=20)
    assert one == pytest.approx(other, rel=1e-6)
    assert one >= middle * (1 - 1e-4)


def test_a_second_bearing_stiffens_it(axes):
    free, fixed = (
        rod_frequency(changed(axes["M"], support=s), 0.4, 0.0) for s in ("fixed-free", "fixed-fixed")
    )
    assert fixed > 1.1 * free


@pytest.mark.parametrize("end", [0.0, 0.9])
def test_the_nut_a_hair_from_the_end_of_the_screw_spoils_no_digit(axes, end):
    step = np.array([0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6]) * (1 if end == 0 else -1)
    got = rod_frequency(axes["M"], end + step - 0.12, 0.0)
    np.testing.assert_allclose(got, got[0], rtol=1e-5)
    np.testing.assert_allclose(got[:4], got[0], rtol=3e-8)


# Arguments.


def test_shapes_follow_numpy(axes):
    x, load = np.array([[0.0], [0.1], [0.2]]), np.array([0.0, 50.0])
    got = rod_frequency(axes["M"], x, load, elements=10)
    assert got.shape == (3, 2)
    assert got[2, 1] == rod_frequency(axes["M"], 0.2, 50.0, elements=10)
    assert rod_frequency(axes["M"], 0.0, 0.0, elements=10).shape == ()
    assert rod_frequency(axes["M"], [], 0.0).shape == (0,)


def test_a_given_rigidity_stands_in_the_place_of_the_preload(axes):
    sheet = axes["M"]
    screw = sheet.screw
    nut = compliance.nut_rigidity(340.0, screw.rigidity, screw.dynamic_load_rating, 0.1)
    from_preload = rod_frequency(sheet, 0.1, 0.0, 340.0, elements=20)
    assert rod_frequency(sheet, 0.1, 0.0, nut_rigidity=nut, elements=20) == pytest.approx(float(from_preload))
    assert np.all(np.diff(rod_frequency(sheet, 0.1, 0.0, nut_rigidity=[1e7, 1e8, 1e9], elements=20)) > 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"position": 0.79}, "a position of 0.79 was given; it must be between -0.12 and 0.78 m"),
        ({"position": -0.13}, "a position of -0.13 was given"),
        ({"position": np.nan}, "a position of nan was given"),
        ({"load": -1}, "a load of -1 was given; it must be a mass, 0 kg or more"),
        ({"preload": 0}, "a preload of 0 was given; it must be more than 0 N"),
        ({"rotor": "loose"}, "the rotor is 'loose'; it must be 'free' or 'held'"),
        ({"nut_rigidity": 0.0}, "a nut rigidity of 0 was given; it must be more than 0 N/m"),
        ({"nut_rigidity": np.nan}, "a nut rigidity of nan was given"),
        ({"nut_rigidity": np.inf}, "a nut rigidity of inf was given"),
        ({"elements": 1}, "elements is 1; it must be a whole number, 2 or more and 2000 or less"),
        ({"elements": 10**6}, "elements is 1000000"),
        ({"elements": 20.0}, "elements is 20.0"),
    ],
)
def test_impossible_arguments(axes, arguments, message):
    for function in (rod_modes, rod_frequency):
        with pytest.raises(InputError, match=message):
            function(axes["M"], **({"position": 0.0, "load": 0.0} | arguments))


@pytest.mark.parametrize("count", [0, 21, True, None])
def test_an_impossible_number_of_modes(axes, count):
    with pytest.raises(InputError, match=r"count is .*; it must be a whole number, 1 or more and 20 or less"):
        rod_modes(axes["M"], 0.0, 0.0, elements=20, count=count)


def test_modes_are_of_one_case(axes):
    with pytest.raises(
        InputError, match="one position, load and preload at a time; rod_frequency takes arrays"
    ):
        rod_modes(axes["M"], [0.0, 0.1], 0.0)


# The bench, whose sheet does not say all of what it is.


@cache
def bench_errors(bench, state, preload, rotor):
    """Relative errors at every other stop, of the rod and of the lumped form."""
    truth = json.loads((bench / "truth.json").read_text(encoding="utf-8"))[state]
    stops = truth["axial_natural_frequency_Hz" if rotor == "free" else "rotor_held_frequency_Hz"]
    x, f = np.array([float(k) for k in stops])[::2], np.array(list(stops.values()))[::2]
    sheet = read_axis(bench / "axis.toml")
    return tuple(g(sheet, x, 100.0, preload, rotor) / f - 1 for g in (rod_frequency, lumped_frequency))


BENCH_PRELOADS = (("preload-4-percent", 600.0), ("preload-2-percent", 300.0))


@pytest.mark.parametrize("rotor", ["free", "held"])
@pytest.mark.parametrize(("state", "preload"), BENCH_PRELOADS)
def test_on_the_bench_it_is_low_by_the_same_part_at_every_stop(bench, state, preload, rotor):
    rod, lumped = bench_errors(bench, state, preload, rotor)
    assert np.ptp(rod) <= np.ptp(lumped)
    assert np.ptp(rod) < 0.002
    assert np.all((rod > -0.05) & (rod < 0))


def test_by_which_part_it_is_low_on_the_foreign_bench(foreign_bench):
    for rotor, low, high in (("free", -0.0225, -0.0205), ("held", -0.0390, -0.0372)):
        for state, preload in BENCH_PRELOADS:
            rod, _ = bench_errors(foreign_bench, state, preload, rotor)
            assert np.all((rod > low) & (rod < high))
