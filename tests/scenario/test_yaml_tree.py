import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario.yaml_tree import entry_names, merge, parse_yaml, set_key
from scenario.yaml_trees import trees

# Parsing.


@pytest.mark.parametrize("text", ["", "# a comment\n", "---\n"])
def test_a_file_without_content_is_none(text):
    assert parse_yaml(text, "f") is None


def test_a_tag_becomes_an_entry_of_its_mapping():
    assert parse_yaml("a: !Foo {b: 1}", "f") == {"a": {"_tag": "!Foo", "b": 1}}


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "a: [1",
        "a:\t1\n\tb: 2",
        "a: 1\n---\nb: 2",
        "a: \x00",
        "a: !Foo 3",
        "a: *nothing",
        "[1, 2]: 3",
        "a: " + "[" * 2000,
    ],
)
def test_invalid_yaml_is_reported_in_one_line(text):
    with pytest.raises(ScenarioError, match=r"^f: not valid YAML: ") as error:
        parse_yaml(text, "f")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", ["1", "yes", "~", "2.5"])
@pytest.mark.parametrize("text", ["{}: 1", "a: {{{}: 1}}", "a: [{{{}: 1}}]"])
def test_keys_must_be_text(key, text):
    with pytest.raises(ScenarioError, match=r"^f: keys must be text"):
        parse_yaml(text.format(key), "f")


def test_a_part_that_contains_itself_is_refused():
    with pytest.raises(ScenarioError, match=r"^f: .*contains itself"):
        parse_yaml("a: &x [1, [*x]]", "f")
    shared = parse_yaml("a: &x [1]\nb: [*x, *x]", "f")
    assert shared == {"a": [1], "b": [[1], [1]]}


# Bases and overrides.


def test_merge_lays_mappings_over_mappings():
    base = {"a": {"b": 1, "c": 2}, "d": [1, 2]}
    assert merge(base, {"a": {"c": 3}, "d": [4]}) == {"a": {"b": 1, "c": 3}, "d": [4]}


def test_merge_replaces_a_mapping_with_another_tag():
    base = {"_tag": "!A", "b": 1}
    assert merge(base, {"_tag": "!C", "d": 2}) == {"_tag": "!C", "d": 2}
    assert merge(base, {"_tag": "!A", "d": 2}) == {"_tag": "!A", "b": 1, "d": 2}
    assert merge(base, {"d": 2}) == {"_tag": "!A", "b": 1, "d": 2}


@pytest.mark.slow
@given(trees, trees)
def test_merge_is_idempotent_and_changes_neither_argument(base, override):
    before = repr((base, override))
    try:
        merged = merge(base, override)
    except ScenarioError:  # the override names an entry that a list does not have
        merged = None
    assert repr((base, override)) == before
    if merged is not None:
        assert repr(merge(merged, override)) == repr(merged)


DIRECTIVES = """
- add_model: {name: table, file: "package://p/table.sdf"}
- add_weld: {parent: world, child: "table::top"}
- add_directives: {file: "package://p/arm_tip.dmd.yaml"}
- {name: lamp, power: 3}
"""


def test_entries_are_named_after_what_they_add():
    names = entry_names(parse_yaml(DIRECTIVES, "f"))
    assert names == ["table", "table::top", "arm_tip", "lamp"]


@pytest.mark.parametrize("text", ["[]", "[1, 2]", "[{name: a}, {power: 2}]", "[[1]]"])
def test_a_list_has_names_only_if_all_its_entries_do(text):
    assert entry_names(parse_yaml(text, "f")) == []


def test_entries_of_a_list_are_overridden_by_name():
    base = {"directives": parse_yaml(DIRECTIVES, "f")}
    merged = merge(base, {"directives": {"table": {"add_model": {"file": "x.sdf"}}}})
    assert merged["directives"][0] == {"add_model": {"name": "table", "file": "x.sdf"}}
    assert merged["directives"][1:] == base["directives"][1:]


def test_an_index_is_refused_and_the_name_is_suggested():
    base = {"directives": parse_yaml(DIRECTIVES, "f")}
    message = (
        r"^f: directives: entries are overridden by name, got '1' \(write "
        r"'table::top' instead of '1'; allowed: table, table::top, arm_tip, lamp\)$"
    )
    with pytest.raises(ScenarioError, match=message):
        merge(base, {"directives": {"1": {}}}, "f")


def test_an_unknown_name_is_refused_and_the_names_are_listed():
    base = {"directives": parse_yaml(DIRECTIVES, "f")}
    message = r"f: directives: .* got 'chair' \(allowed: table, table::top, arm_tip"
    with pytest.raises(ScenarioError, match=message):
        merge(base, {"directives": {"chair": {}}}, "f")


def test_a_list_without_names_is_overridden_as_a_whole():
    assert merge({"a": [1, 2]}, {"a": [3]}) == {"a": [3]}
    with pytest.raises(ScenarioError, match=r"^f: a: entries have no names: override"):
        merge({"a": [1, 2]}, {"a": {"0": 3}}, "f")


def test_a_distribution_replaces_a_list():
    vector = {"_tag": "!UniformVector", "min": [0], "max": [1]}
    assert merge({"a": [1]}, {"a": vector}) == {"a": vector}


def test_set_key_adds_mappings_on_the_way():
    tree = {"a": {"b": 1}, "n": None}
    set_key(tree, "a.c.d", 2)
    set_key(tree, "n.m", 3)
    assert tree == {"a": {"b": 1, "c": {"d": 2}}, "n": {"m": 3}}


def test_set_key_to_an_empty_mapping_replaces_the_old_value():
    tree = {"a": {"b": 1}, "c": {"_tag": "!C", "d": 1}}
    set_key(tree, "a", {})
    set_key(tree, "c", {"_tag": "!C"})
    assert tree == {"a": {}, "c": {"_tag": "!C", "d": 1}}


def test_set_key_cannot_lead_through_a_scalar():
    with pytest.raises(ScenarioError, match=r"--set a\.b\.c: a\.b is a value"):
        set_key({"a": {"b": 1}}, "a.b.c", 2)


def test_set_key_finds_list_entries_by_name():
    tree = {"directives": parse_yaml(DIRECTIVES, "f")}
    set_key(tree, "directives.table::top.add_weld.parent", "floor::top")
    set_key(tree, "directives.lamp.power", 4)
    assert tree["directives"][1]["add_weld"]["parent"] == "floor::top"
    assert tree["directives"][3]["power"] == 4
    message = r"^--set directives\.3\.power: directives: .*write 'lamp' instead of '3'"
    with pytest.raises(ScenarioError, match=message):
        set_key(tree, "directives.3.power", 5)


def test_set_key_finds_entries_of_lists_without_names_by_index():
    tree = {"a": [{"b": 1}, {"c": [3, 4]}]}
    set_key(tree, "a.0.b", 2)
    set_key(tree, "a.0.d.e", 5)
    set_key(tree, "a.1.c.1", 6)
    assert tree == {"a": [{"b": 2, "d": {"e": 5}}, {"c": [3, 6]}]}


@pytest.mark.parametrize("index", ["2", "-1", "x", "1.5", "", "²"])
@pytest.mark.parametrize("rest", ["", ".b"])
def test_set_key_needs_an_existing_index(index, rest):
    with pytest.raises(ScenarioError) as error:
        set_key({"a": [{"b": 1}, 2]}, f"a.{index}{rest}", 3)
    if index != "1.5":  # its 1 is an index, but of a scalar
        assert "unknown index" in str(error.value)


def test_set_key_finds_no_entry_in_an_empty_list():
    with pytest.raises(
        ScenarioError, match=r"unknown index '0' \(allowed: none, the list is empty\)"
    ):
        set_key({"a": []}, "a.0", 1)


@given(st.lists(st.integers(), min_size=1, max_size=4), st.data())
def test_set_key_changes_one_entry_of_a_list(values, data):
    i = data.draw(st.integers(0, len(values) - 1))
    tree = {"a": list(values)}
    set_key(tree, f"a.{i}", "new")
    assert tree == {"a": [*values[:i], "new", *values[i + 1 :]]}
