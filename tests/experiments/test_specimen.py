from drake_srg.experiments.specimen import drive_of


def test_at_the_same_effort_the_specimen_pulls_less():
    for effort in (0.2, 0.5, 0.8, 1.0):
        sheet, real = (
            drive_of(model).wire_force_of(effort)
            for model in ("data sheet", "specimen")
        )
        assert real < 0.8 * sheet
