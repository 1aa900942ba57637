from make_site.rules import rules, rules_page

CHECKS = """
_SCHEME = "cenic"

def _step_problems(scenario):
    for key, value in (("a.b", scenario.b), ("a.c", scenario.c)):
        if not value > 0.0:
            yield key, f"must be greater than 0.0, got {value}"
    for name, config in scenario.objects.items():
        if config.soft:
            problem = f"must be null with {_SCHEME}"
            yield f"objects.{name}.soft", problem

def _other(scenario):
    yield "x", "y"
"""


def test_rules_are_read_from_the_code():
    assert set(rules(CHECKS)) == {
        ("objects.NAME.soft", "must be null with cenic"),
        ("a.b", "must be greater than 0.0"),
        ("a.c", "must be greater than 0.0"),
    }


def test_the_page_has_the_rules_of_a_scenario():
    page = rules_page()
    assert "| `plant_config.stiction_tolerance` | `must be greater than 0.0` |" in page
    assert "| `objects.NAME.soft` | `needs a shape (allowed: !Box)` |" in page
    assert page.count("\n") > 40
