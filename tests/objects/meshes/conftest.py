import pytest

from drake_srg.objects.meshes import load


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    """Give each test an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for cached in (load._tree, load._taken, load._named_files):
        cached.cache_clear()
