"""The fast kitchen with two arms, as scenario files state them."""

from drake_srg.scenario.load import draw_scenario, load_tree
from drake_srg.scenario.typed_yaml import parse_yaml

MODELS = """
directives:
- add_model: {name: table, file: package://drake_srg/sdf/table.sdf}
- add_model: {name: left, file: package://drake_srg/sdf/iiwa14.sdf}
- add_weld: {parent: table::table_top, child: left::link_0}
- add_model: {name: left.gripper, file: package://drake_srg/sdf/srg_fast.sdf}
- add_weld:
    parent: left::flange
    child: left.gripper::palm
    X_PC: {rotation: !Rpy {deg: [0, -90, 0]}}
- add_model: {name: right, file: package://drake_srg/sdf/iiwa14.sdf}
- add_weld:
    parent: table::table_top
    child: right::link_0
    X_PC: {translation: [1.2, 0.0, 0.0], rotation: !Rpy {deg: [0, 0, 180]}}
- add_model: {name: right.gripper, file: package://drake_srg/sdf/srg_fast.sdf}
- add_weld:
    parent: right::flange
    child: right.gripper::palm
    X_PC: {rotation: !Rpy {deg: [0, -90, 0]}}
"""


def two_arm_tree(base="kitchen_fast"):
    """The tree of a scenario with the arms `left` and `right`."""
    tree = load_tree(base)
    each = {key: tree.pop(key) for key in ("arm", "gripper")}
    names = ("arm::*", "gripper::*")
    tree["ignored_contacts"] = [
        p for p in tree.get("ignored_contacts", ()) if not set(p) & set(names)
    ]
    tree["directives"] = parse_yaml(MODELS, "models")["directives"]
    tree["cameras"].pop("fingers")
    tree["recording"]["inset_camera"] = ""
    tree["arms"] = {"left": each, "right": {**each}}
    return tree


def two_arms(change=lambda tree: None, base="kitchen_fast", seed=0):
    """Return the scenario of two arms, loaded."""
    tree = two_arm_tree(base)
    change(tree)
    return draw_scenario(tree, "mine.yaml", seed).scenario
