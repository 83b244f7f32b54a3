"""Settings are strict, and every refusal is a sentence that helps."""

from __future__ import annotations

from types import MappingProxyType

import pytest
from pydantic import ValidationError

from pipeline import Settings, UserError, group, setting, settings_of
from pipeline.cache.digest import digest_value
from pipeline.config import check_settings, override, read_config
from pipeline.settings import settings_that_matter
from stages.raycast import RaycastSettings
from stages.undistort import UndistortSettings
from tests.toy_flow import COUNT, CountSettings, JoinSettings

DECLARED = {"join": JoinSettings, "count": CountSettings}


def checked(*assignments: str):
    return check_settings(DECLARED, override({}, assignments))


def test_assignments_are_read_as_yaml():
    assert checked("count.times=3")["count"].times == 3
    assert checked("count.lambda=2")["count"].lambda_ == 2.0
    assert checked("count.lambda=1e-6")["count"].lambda_ == 1e-6  # the library alone would make text of it
    assert checked("join.chatty=true")["join"].chatty is True


@pytest.mark.parametrize(
    ("assignment", "sentence"),
    [
        ("raycast.views=001", """raycast.views is 1; expected a list, as in [1.5, 2] or ["001", "b"]."""),
        ("raycast.views=[001]", """raycast.views.0 is 1; expected text, in quotes where it would pass for"""),
    ],
)
def test_what_yaml_makes_of_a_name_of_digits_is_explained(assignment, sentence):
    with pytest.raises(UserError) as error:
        check_settings({"raycast": RaycastSettings}, override({}, [assignment]))
    assert sentence in str(error.value)
    given = override({}, ['raycast.views=["001"]'])
    assert check_settings({"raycast": RaycastSettings}, given)["raycast"].views == ("001",)


@pytest.mark.parametrize("nothing", ["none", "None", "null", "~"])
def test_none_is_written_as_the_documentation_writes_it(nothing):
    given = override({}, [f"undistort.max_size_px={nothing}"])
    assert check_settings({"undistort": UndistortSettings}, given)["undistort"].max_size_px is None


@pytest.mark.parametrize(
    ("assignment", "sentence"),
    [
        ("count.tims=3", "There is no setting count.tims; did you mean 'times'?"),
        ("count.glue=3", "count.glue has moved to join.separator; set it there."),
        ("cuont.times=3", "There is no stage 'cuont' to set; did you mean 'count'?"),
        ("count.times=0", "count.times is 0; expected greater than or equal to 1."),
        ("count.times=many", "count.times is 'many'; expected a valid integer."),
        ("count.times=2.5", "count.times is 2.5; expected a valid integer"),
        ("count.lambda=.nan", "count.lambda is nan; expected a finite number."),
        ("count.lambda=.inf", "count.lambda is inf; expected a finite number."),
        ("count.lambda=1e999", "count.lambda is inf; expected a finite number."),
        ("join.chatty=1", "join.chatty is 1; expected a valid boolean."),
        ("times=3", "--set times=3 was not understood; expected STAGE.SETTING=VALUE"),
        ("count.times", "--set count.times was not understood"),
        ("count.times={", "the value is not YAML"),
        ("count.times=2020-01-01", "count.times is '2020-01-01'; expected a valid integer."),
    ],
)
def test_a_refusal_names_setting_value_and_expectation(assignment, sentence):
    with pytest.raises(UserError) as error:
        checked(assignment)
    assert sentence in str(error.value)


def test_settings_are_frozen():
    with pytest.raises(ValidationError):
        CountSettings().times = 3


def test_silent_settings_stay_out_of_the_key():
    assert settings_that_matter(JoinSettings(chatty=True)) == {"separator": " "}
    assert settings_that_matter(CountSettings()) == {"times": 1, "lambda": 1.0}


class InkSettings(Settings):
    moved = MappingProxyType({"tint": "print.ink.colour"})
    colour: str = setting("black", "Of the ink.")
    drops: int = setting(3, "Per word.", ge=1)
    loud: bool = setting(False, "Changes nothing.", changes_result=False)


class PrintSettings(Settings):
    copies: int = setting(1, "How many.", ge=1)
    ink: InkSettings = group(InkSettings, "What words are printed with.")


def printed(*assignments: str) -> PrintSettings:
    return check_settings({"print": PrintSettings}, override({}, assignments))["print"]


def test_a_phase_has_settings_of_its_own_after_a_dot():
    settings = printed("print.ink.drops=5", "print.copies=2")
    assert (settings.copies, settings.ink) == (2, InkSettings(drops=5))
    assert settings_that_matter(settings) == {"copies": 2, "ink.colour": "black", "ink.drops": 5}
    config = {"print": {"ink": {"colour": "blue"}}}
    both = override(config, ["print.ink.drops=5"])
    assert both == {"print": {"ink": {"colour": "blue", "drops": 5}}}
    assert config == {"print": {"ink": {"colour": "blue"}}}


def test_what_a_variant_of_a_stage_ignores_stays_out_of_its_key():
    assert settings_that_matter(PrintSettings(), ["ink"]) == {"copies": 1}
    assert settings_that_matter(PrintSettings(), ["ink.drops", "copies"]) == {"ink.colour": "black"}


@pytest.mark.parametrize(
    ("assignment", "sentence"),
    [
        ("print.ink.drop=3", "There is no setting print.ink.drop; did you mean 'drops'?"),
        ("print.ikn.drops=3", "There is no setting print.ikn; did you mean 'ink'?"),
        ("print.ink.tint=red", "print.ink.tint has moved to print.ink.colour; set it there."),
        ("print.ink.drops=0", "print.ink.drops is 0; expected greater than or equal to 1."),
        ("print.ink=3", "print.ink is 3; expected settings of its own, as in print.ink.colour."),
        ("print.copies.many=3", "print.copies is {'many': 3}; expected a valid integer."),
        ("print..drops=3", "--set print..drops=3 was not understood"),
    ],
)
def test_a_refusal_names_the_setting_of_a_phase(assignment, sentence):
    with pytest.raises(UserError) as error:
        printed(assignment)
    assert sentence in str(error.value)


def test_a_config_keeps_its_folder_for_relative_paths(tmp_path):
    path = tmp_path / "job.yaml"
    path.write_text("workspace: here\nsources: {words: ../words}\ncount: {times: 2}\n")
    config = read_config(path, ["words"], DECLARED)
    assert (config.folder, config.workspace, config.sources) == (tmp_path, "here", {"words": "../words"})
    assert config.settings == {"count": {"times": 2}}


def test_an_empty_section_is_one_without_settings(tmp_path):
    path = tmp_path / "job.yaml"
    path.write_text("sources:\ncount:\n")
    config = read_config(path, ["words"], DECLARED)
    assert (config.sources, config.settings) == ({}, {"count": {}})


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("cuont: {times: 2}", "unknown section 'cuont'; did you mean 'count'?"),
        ("sources: {wrods: x}", "no source 'wrods'; did you mean 'words'?"),
        ("count: 3", "the section 'count' is 3; expected"),
        ("[1, 2]", "holds list; expected sections"),
        ("workspace: [1, 2]", "workspace is [1, 2]; expected a path or a name"),
        ("workspace:", "workspace is None; expected a path or a name"),
        ("sources: {words: }", "words is None; expected a path or a name"),
        ("sources: {words: 2024}", "words is 2024; expected a path or a name, in quotes where"),
        ("sources: {words: ''}", "words is ''; expected a path or a name"),
        (
            "count: {times: 2}\njoin: {}\ncount: {lambda: 2}",
            "a second 'count', but each was expected once",
        ),
        ("count: {times: 2, times: 3}", "a second 'times'"),
        ("a: [", "is not YAML"),
        ("a: !!python/object:os.system {}", "is not YAML"),
    ],
)
def test_a_bad_config_is_refused_in_a_sentence(tmp_path, text, sentence):
    path = tmp_path / "job.yaml"
    path.write_text(text)
    with pytest.raises(UserError) as error:
        read_config(path, ["words"], DECLARED)
    assert sentence in str(error.value)


def test_a_missing_config_is_named(tmp_path):
    with pytest.raises(UserError, match="nowhere.yaml cannot be read"):
        read_config(tmp_path / "nowhere.yaml", [], [])


def test_a_name_that_a_stage_had_once_is_answered_with_that_of_today(tmp_path):
    renamed = {"tally": "count"}
    with pytest.raises(UserError, match="There is no stage 'tally' to set; it is called 'count' now."):
        check_settings(DECLARED, {"tally": {}}, renamed)
    path = tmp_path / "job.yaml"
    path.write_text("tally: {times: 2}\n")
    with pytest.raises(UserError, match="unknown section 'tally'; it is called 'count' now."):
        read_config(path, [], DECLARED, renamed)


def test_a_stage_gets_its_own_settings_and_refuses_anothers():
    own = CountSettings(times=3)
    assert settings_of(COUNT, {"join": JoinSettings(), "count": own}) is own
    with pytest.raises(TypeError, match="count takes CountSettings; got JoinSettings"):
        settings_of(COUNT, {"count": JoinSettings()})


def test_digests_tell_types_apart_and_ignore_the_order_of_names():
    values = [1, 1.0, True, "1", None, [1], [[1]], {"a": 1}, {"a": "1"}, "a", ""]
    assert len({digest_value(value) for value in values}) == len(values)
    assert digest_value({"a": 1, "b": 2}) == digest_value({"b": 2, "a": 1})
    with pytest.raises(TypeError):
        digest_value(object())
