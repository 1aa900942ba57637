from drake_srg.scenario import SCENARIOS


def test_both_specimens_have_the_same_gripper():
    blocks = {
        (SCENARIOS / f"{name}.yaml").read_text(encoding="utf-8").split("gripper: ")[1]
        for name in ("srg_specimen", "kitchen_tendon_specimen")
    }
    assert len(blocks) == 1
