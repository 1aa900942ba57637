import gc
import weakref

from drake_srg.common.garbage import short_collections


class Cycle:
    def __init__(self):
        self.self = self


def test_what_exists_is_not_looked_at_meanwhile():
    with short_collections():
        assert gc.get_freeze_count() > 1000
    assert gc.get_freeze_count() == 0


def test_new_garbage_is_collected_meanwhile():
    with short_collections():
        seen = weakref.ref(Cycle())
        gc.collect()
        assert seen() is None


def test_an_error_ends_it():
    try:
        with short_collections():
            raise KeyError
    except KeyError:
        assert gc.get_freeze_count() == 0
