import pytest
from pydantic import Field

from survey import ConfigError, InputError
from survey.core.config import Section, read_toml, validated, with_overrides


class Inner(Section):
    spacing_m: float = 1.0


class Outer(Section):
    inner: Inner = Inner()
    count: int = 2
    corner: tuple[float, float] = (0.0, 0.0)


def test_unknown_keys_are_refused_with_the_nearest_known_one():
    with pytest.raises(ConfigError, match=r"inner\.spaceing_m is not known; did you mean spacing_m"):
        validated(Outer, {"inner": {"spaceing_m": 2.0}}, "m.toml")


@pytest.mark.parametrize("value", ["3", 2.5, True, None, [1]])
def test_values_are_never_converted(value):
    with pytest.raises(ConfigError, match="count"):
        validated(Outer, {"count": value}, "m.toml")


def test_lists_stand_for_tuples_and_whole_numbers_for_floats():
    built = validated(Outer, {"corner": [1, 2.5], "inner": {"spacing_m": 3}}, "m.toml")
    assert built.corner == (1.0, 2.5)
    assert built.inner.spacing_m == 3.0


def test_the_number_of_other_wrong_settings_is_stated():
    with pytest.raises(ConfigError, match=r"; 1 more setting is wrong; correct it"):
        validated(Outer, {"count": "3", "corner": "x"}, "m.toml")
    with pytest.raises(ConfigError, match=r"; 2 more settings are wrong; correct it"):
        validated(Outer, {"count": "3", "corner": "x", "inner": {"spacing_m": "y"}}, "m.toml")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_not_finite_is_refused(value):
    with pytest.raises(ConfigError):
        validated(Outer, {"inner": {"spacing_m": value}}, "m.toml")


def test_overrides_do_not_touch_the_original():
    values = {"inner": {"spacing_m": 1.0}}
    assert with_overrides(values, ["inner.spacing_m=4", "count=3"]) == {"inner": {"spacing_m": 4}, "count": 3}
    assert values == {"inner": {"spacing_m": 1.0}}


@pytest.mark.parametrize("override", ["inner", "=3", "count.deep=1"])
def test_malformed_overrides_are_refused(override):
    with pytest.raises(ConfigError):
        with_overrides({"count": 1}, [override])


def test_broken_toml_is_named(tmp_path):
    (tmp_path / "m.toml").write_text("a = [1,")
    with pytest.raises(ConfigError, match=r"m\.toml is not valid TOML"):
        read_toml(tmp_path / "m.toml")
    with pytest.raises(InputError, match="does not exist"):
        read_toml(tmp_path / "other.toml")


class Lines(Section):
    swaths: int = 4


class Pattern(Section):
    inner: Lines = Lines()
    spacing_m: float = Field(default=1.0, gt=0.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Lines(swath=3), "Lines: the key swath is not known; did you mean swaths?"),
        (lambda: Lines(swaths="many"), r"Lines: swaths: input should be a valid integer \(found 'many'\)"),
        (lambda: Pattern(spacing_m=-1.0), "Pattern: spacing_m: input should be greater than 0"),
        (lambda: Pattern(inner={"swaths": 1.5}), "Pattern: inner.swaths: input should be a valid integer"),
    ],
)
def test_a_wrong_setting_of_a_section_made_in_python_is_a_config_error(build, message):
    with pytest.raises(ConfigError, match=message):
        build()


def test_settings_are_given_by_keyword():
    with pytest.raises(TypeError, match=r"Lines takes settings by keyword only, e.g. Lines\(swaths=...\)"):
        Lines(3)


def test_a_byte_order_mark_before_toml_is_read_over(tmp_path):
    file = tmp_path / "camera.toml"
    file.write_text("width = 640\n", encoding="utf-8-sig")
    assert read_toml(file) == {"width": 640}
