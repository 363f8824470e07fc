from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballscrew.axis.model import guide_friction
from ballscrew.axis.sheet import Limits
from ballscrew.axis.sheet_file import axis_toml, read_axis
from ballscrew.base.errors import InputError


def test_a_sheet_in_si(sheets):
    sheet = sheets.read()
    assert (sheet.name, sheet.support, sheet.source) == ("bench", "fixed-free", "axis.toml")
    assert sheet.screw.lead == pytest.approx(0.010)
    assert sheet.screw.root_diameter == pytest.approx(0.0176)
    assert sheet.screw.nominal_diameter == pytest.approx(0.020)
    assert sheet.screw.rigidity == pytest.approx(480e6)
    assert sheet.screw.dynamic_load_rating == pytest.approx(15e3)
    assert sheet.bearing.stiffness == pytest.approx(160e6)
    assert sheet.table.mass == 32
    assert sheet.drive.rotor_inertia == pytest.approx(4.2e-4)
    assert sheet.guide.friction == 25
    assert sheet.nominal_preload == pytest.approx(600)
    assert sheet.travel_limit == pytest.approx(0.57)


def test_what_need_not_be_given(sheets):
    sheet = sheets.read(screw__nominal_diameter=None)
    assert sheet.screw.nominal_diameter == sheet.screw.root_diameter
    assert (sheet.screw.youngs_modulus, sheet.screw.shear_modulus, sheet.screw.density) == (206e9, 80e9, 7850)
    assert sheet.drive.torque_constant is None
    assert sheet.drive.coupling_stiffness is None
    assert sheet.tolerances == {}


def test_what_may_be_given(sheets):
    sheet = sheets.read(
        screw__youngs_modulus="210 GPa",
        drive__torque_constant="0.5 N m/A",
        drive__coupling_stiffness="5 kN m/rad",
        tolerances={"rigidity": "20 %", "stiffness": 0.3},
    )
    assert sheet.screw.youngs_modulus == pytest.approx(210e9)
    assert sheet.drive.torque_constant == pytest.approx(0.5)
    assert sheet.drive.coupling_stiffness == pytest.approx(5000)
    assert sheet.tolerances == {"rigidity": pytest.approx(0.2), "stiffness": 0.3}
    assert hash(sheet)


def test_an_axis_is_horizontal_and_driven_directly_unless_stated(sheets):
    sheet = sheets.read()
    assert (sheet.orientation, sheet.inclination, sheet.table.counterbalance) == ("horizontal", 0.0, 0.0)
    assert (sheet.drive.ratio, sheet.drive.belt_stiffness, sheet.drive.rotating) == (1.0, None, "screw")
    assert (sheet.bearing.far_stiffness, sheet.bearing.pretension) == (None, None)


def test_orientation_transmission_and_pretension_survive_writing(sheets, tmp_path):
    sheet = sheets.read(
        support="fixed-fixed",
        orientation="inclined",
        inclination="30 deg",
        positive="down",
        bearing__far_stiffness="90 N/um",
        bearing__pretension="3 kN",
        table__counterbalance="300 N",
        drive__ratio=2,
        drive__belt_stiffness="8 kN m/rad",
        tolerances={"belt_stiffness": 0.3, "ratio": 0.01, "pretension": 0.2},
    )
    assert sheet.inclination == pytest.approx(math.pi / 6)
    path = tmp_path / "axis.toml"
    path.write_text(axis_toml(sheet), encoding="utf-8")
    assert replace(read_axis(path), source=sheet.source) == sheet


@pytest.mark.parametrize(
    "name", ["pretension", "far_stiffness", "rigidity_load_ratio", "counterbalance", "coupling_stiffness"]
)
def test_a_tolerance_of_a_field_that_the_sheet_does_not_state_is_refused(sheets, name):
    with pytest.raises(InputError, match=f"the data sheet does not state {name}"):
        sheets.read(tolerances={name: 0.1})


def test_a_vertical_axis_needs_no_inclination(sheets):
    assert sheets.read(orientation="vertical").inclination == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"orientation": "inclined"}, "inclination is missing"),
        ({"orientation": "inclined", "inclination": 30}, "inclination is 30"),
        ({"inclination": "30 deg"}, "left out where orientation is 'horizontal'"),
        ({"orientation": "upright"}, "one of horizontal, inclined, vertical"),
        ({"table__counterbalance": "300 N"}, "left out where orientation is 'horizontal'"),
        ({"positive": "down"}, "left out where orientation is 'horizontal'"),
        ({"orientation": "vertical", "table__counterbalance": "1 MN"}, "at most 5 times the weight"),
        ({"bearing__far_stiffness": "90 N/um"}, "left out where support is 'fixed-free'"),
        (
            {"support": "fixed-fixed", "bearing__far_stiffness": "90 N/um", "drive__rotating": "nut"},
            "left out where drive.rotating is 'nut'",
        ),
        ({"drive__ratio": 0}, "drive.ratio is 0"),
        ({"drive__rotating": "table"}, "one of screw, nut"),
    ],
)
def test_contradictory_orientation_transmission_or_bearing_is_refused(sheets, fields, message):
    with pytest.raises(InputError, match=message):
        sheets.read(**fields)


def test_the_convention_of_the_rigidity(sheets):
    none = {"screw__rigidity_preload_ratio": None}
    assert sheets.read().screw.rigidity_convention == "preloaded"
    assert sheets.read(**none).screw.rigidity_convention == "unknown"
    clearance = sheets.read(**none, screw__rigidity_convention="clearance").screw
    assert (clearance.rigidity_preload_ratio, clearance.rigidity_load_ratio) == (None, 0.30)
    measured = sheets.read(**none, screw__rigidity_convention="measured", screw__preload_by="spacer").screw
    assert (measured.rigidity_preload_ratio, measured.preload_by) == (None, "spacer")


def test_settings_of_a_sheet_without_the_fields_have_none_of_them(sheets):
    screw = sheets.read().to_settings()["screw"]
    assert not {"rigidity_convention", "rigidity_load_ratio", "preload_by"} & screw.keys()


def test_the_contact_in_older_sheets_has_no_effect(sheets):
    assert sheets.read(screw__contact="four-point") == sheets.read()


def test_guide_friction_is_two_per_cent_of_the_weight_where_not_stated(sheets, tmp_path):
    sheet = sheets.read(guide=None)
    assert float(guide_friction(sheet, 18.0)) == pytest.approx(0.02 * 50 * 9.80665)
    assert float(guide_friction(sheets.read(guide__friction="0 N"), 18.0)) == 0
    path = tmp_path / "written.toml"
    path.write_text(axis_toml(sheet), encoding="utf-8")
    assert replace(read_axis(path), source=sheet.source) == sheet


def test_a_tolerance_may_be_a_factor(sheets):
    stated = sheets.read(tolerances={"rigidity": "factor 2", "stiffness": 1.5}).tolerances
    assert stated == {"rigidity": pytest.approx(math.log(2)), "stiffness": 1.5}


def test_the_sheet_of_the_bench(bench):
    sheet = read_axis(bench / "axis.toml")
    assert sheet.nominal_preload == pytest.approx(600)
    assert sheet.screw.nominal_diameter == pytest.approx(0.0176)


def test_settings_are_plain_and_know_no_file_name(sheets, tmp_path):
    settings_ = sheets.read(tolerances={"rigidity": 0.2}).to_settings()
    assert json.loads(json.dumps(settings_)) == settings_
    assert settings_["screw"]["lead"] == pytest.approx(0.01)
    assert "source" not in settings_
    other = sheets.write(tolerances={"rigidity": 0.2}).rename(tmp_path / "other.toml")
    assert read_axis(other).to_settings() == settings_


WRONG = [
    (
        "screw__lead",
        "-10 mm",
        "screw.lead is '-10 mm'; it must be .* converts to m, 0.0001",
    ),
    ("screw__lead", 10, "screw.lead is 10; it must be .*and 1 or less"),  # millimetres without saying so
    ("screw__lead", "10 kg", "screw.lead is '10 kg'; it must be .*the unit 'kg' is not one that can be"),
    ("screw__lead", "TODO", "screw.lead is 'TODO'; it must be a number with a unit that converts to m"),
    ("screw__lead", "TODO mm", "screw.lead is 'TODO mm'; it must be"),
    ("screw__lead", None, "screw.lead is missing; it must be a number with a unit that converts to m"),
    ("screw__lead", True, "screw.lead is True; it must be"),
    ("screw__lead", "nan m", "screw.lead is 'nan m'; it must be"),
    ("screw__lead", ["10 mm"], r"screw.lead is \['10 mm'\]; it must be"),
    ("screw__leed", 1, "screw.leed is not a known field; known are lead, "),
    (
        "screw__root_diameter",
        "21 mm",
        r"screw.nominal_diameter is '20 mm'; it must be the root .*0.021 m",
    ),
    (
        "screw__bearing_to_zero",
        "650 mm",
        r"screw.bearing_to_zero is '650 mm'; it must be less than the",
    ),
    ("screw__bearing_to_zero", "-1 mm", "screw.bearing_to_zero is '-1 mm'; it must be .*0 or more"),
    ("screw__preload_ratio", 0.21, "screw.preload_ratio is 0.21; it must be a plain number, .*0.2 or less"),
    ("screw__preload_ratio", 0, "screw.preload_ratio is 0; it must be"),
    ("screw__preload_ratio", "600 N", "screw.preload_ratio is '600 N'; it must be a plain number"),
    ("screw__rigidity", "480 um/N", "screw.rigidity is '480 um/N'; it must be .* converts to N/m"),
    ("screw__rigidity", 480, "screw.rigidity is 480; it must be"),
    ("support", "free", "support is 'free'; it must be one of fixed-free, fixed-supported, fixed-fixed"),
    ("support", None, "support is missing; it must be one of fixed-free"),
    ("name", None, "name is missing; it must be a text"),
    ("name", "TODO", "name is 'TODO'; it must be the name of the axis"),
    ("name", 3, "name is 3; it must be a text"),
    ("bearing", None, r"\[bearing\] is missing; it must be a table"),
    ("bearing__stiffness", "0 N/um", "bearing.stiffness is '0 N/um'; it must be"),
    ("bearing__rigidity", 1, "bearing.rigidity is not a known field; known are stiffness"),
    ("table__mass", "0 kg", "table.mass is '0 kg'; it must be"),
    ("table__mass", "32 mm", "table.mass is '32 mm'; it must be"),
    ("drive__rotor_inertia", "1 kg", "drive.rotor_inertia is '1 kg'; it must be"),
    ("drive__torque_constant", "0 N m/A", "drive.torque_constant is '0 N m/A'; it must be"),
    ("guide__friction", "-1 N", "guide.friction is '-1 N'; it must be"),
    ("tolerances__rigidity", "20 N", "tolerances.rigidity is '20 N'; it must be a plain number"),
    ("tolerances__rigidity", -0.1, "tolerances.rigidity is -0.1; it must be a plain number, 0 or more"),
    ("tolerances__rigidity", "factor 0.5", "tolerances.rigidity is 'factor 0.5'; it must be 'factor' and a"),
    (
        "tolerances__rigidity",
        "factor x",
        "tolerances.rigidity is 'factor x'; it must be 'factor' and a number",
    ),
    (
        "screw__rigidity_convention",
        "catalogue",
        "screw.rigidity_convention is 'catalogue'; it must be one of",
    ),
    (
        "screw__rigidity_convention",
        "clearance",
        "screw.rigidity_preload_ratio is 0.1; it must be left out where",
    ),
    (
        "screw__rigidity_convention",
        "unknown",
        "screw.rigidity_preload_ratio is 0.1; it must be left out where",
    ),
    ("screw__rigidity_load_ratio", 0.3, "screw.rigidity_load_ratio is 0.3; it must be left out unless"),
    ("screw__preload_by", "glue", "screw.preload_by is 'glue'; it must be one of spacer, offset lead"),
    ("tolerances__contact", 0.1, "tolerances.contact is not a known field"),
    ("motor", {"a": 1}, "motor is not a known field"),
]


@pytest.mark.parametrize(("field", "value", "message"), WRONG)
def test_an_impossible_field_is_one_sentence(sheets, field, value, message):
    with pytest.raises(InputError, match=rf"^axis\.toml: {message}") as error:
        sheets.read(**{field: value})
    assert str(error.value).endswith(".")
    assert "\n" not in str(error.value)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    field=st.sampled_from(["lead", "root_diameter", "length", "rigidity", "preload_ratio"]),
    value=st.floats() | st.integers() | st.booleans() | st.sampled_from(["", "1 m", "x", "1e999 m", "0 mm"]),
)
def test_any_value_is_a_sheet_that_predicts_or_an_input_error(sheets, field, value):
    from ballscrew.axis.frequency import predicted_frequency

    path = sheets.write(**{f"screw__{field}": value})
    try:
        sheet = read_axis(path)
    except InputError:
        return
    assert 0 < float(predicted_frequency(sheet, 0.0, 0.0)) < 1e6


def test_the_limits_of_a_machine(sheets):
    assert sheets.read().limits == Limits(None, None, None, None)
    sheet = sheets.read(
        limits={
            "lowest_position": "-5 mm",
            "highest_position": "470 mm",
            "speed": "500 mm/s",
            "torque": "8 N m",
        }
    )
    limits = sheet.limits
    assert (limits.lowest_position, limits.highest_position) == (pytest.approx(-0.005), pytest.approx(0.47))
    assert (limits.speed, limits.torque) == (pytest.approx(0.5), pytest.approx(8))
    assert hash(sheet)
    assert sheets.read(limits={"speed": 1}).limits == Limits(speed=1.0)


def test_limits_are_no_part_of_what_numbers_depend_on(sheets):
    assert sheets.read(limits={"speed": 1}).to_settings() == sheets.read().to_settings()


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"speed": "500 mm"}, "limits.speed is '500 mm'; it must be .* converts to m/s"),
        ({"speed": 500}, "limits.speed is 500; it must be .*100 or less"),
        ({"speed": 0}, "limits.speed is 0; it must be"),
        ({"torque": "-1 N m"}, "limits.torque is '-1 N m'; it must be"),
        ({"torque": "8 N"}, "limits.torque is '8 N'; it must be"),
        ({"highest_position": 470}, "limits.highest_position is 470; it must be .*100 or less"),
        ({"lowest_position": "nan m"}, "limits.lowest_position is 'nan m'; it must be"),
        (
            {"lowest_position": 0.4, "highest_position": 0.4},
            r"limits.highest_position is 0.4; it must be more than lowest_position \(0.4 m\)",
        ),
        ({"acceleration": 1}, "limits.acceleration is not a known field; known are lowest_position"),
        ([1], r"limits is \[1\]; it must be a table"),
    ],
)
def test_impossible_limits(sheets, limits, message):
    with pytest.raises(InputError, match=rf"^axis\.toml: {message}"):
        sheets.read(limits=limits)


def back(sheet, folder):
    (folder / "axis.toml").write_text(axis_toml(sheet), encoding="utf-8")
    return replace(read_axis(folder / "axis.toml"), source=sheet.source)


@pytest.mark.parametrize("name", ["S", "M", "L"])
def test_what_is_written_is_read_back(axes, tmp_path, name):
    assert back(axes[name], tmp_path) == axes[name]


def test_with_all_that_may_be_left_out(axes, tmp_path):
    sheet = axes["M"]
    full = replace(
        sheet,
        name='x "y" \\ ü',
        support="fixed-fixed",
        screw=replace(
            sheet.screw,
            rigidity_preload_ratio=None,
            rigidity_convention="clearance",
            rigidity_load_ratio=0.28,
            preload_by="offset lead",
        ),
        drive=replace(sheet.drive, coupling_stiffness=5000.0, torque_constant=0.5),
        tolerances={"rigidity": 0.1},
        limits=Limits(-0.01, 0.5, 0.3, 8.0),
    )
    assert back(full, tmp_path) == full
