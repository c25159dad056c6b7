import os

from skinbake.cli import compiled


def test_a_changed_source_file_gets_new_machine_code(tmp_path, monkeypatch):
    """Whichever file changed, also one whose functions are only inlined elsewhere; the old code is removed."""
    (tmp_path / "a.py").write_text("import numba  # 1\n")
    monkeypatch.setattr(compiled, "PACKAGE", tmp_path)
    folders = []
    for text in ("import numba  # 1\n", "import numba  # 1\n", "import numba  # 2\n"):
        if (tmp_path / "a.py").read_text() != text:
            (tmp_path / "a.py").write_text(text)
        monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
        compiled.use_fresh_cache()
        folders.append(os.environ["NUMBA_CACHE_DIR"])
    assert folders[0] == folders[1] != folders[2]
    assert [str(p) for p in (tmp_path / "__pycache__").iterdir()] == [folders[2]]


def test_a_folder_somebody_chose_is_kept(monkeypatch):
    """A farm may share one."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/somewhere")
    compiled.use_fresh_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == "/somewhere"
