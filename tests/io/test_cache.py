import multiprocessing
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.cache import Cache, cache_folder
from skinbake.io.digests import key_of

KEYS = {name: key_of(name) for name in ("key", "fill", "rim")}


def entry(name, count=1000):
    rng = np.random.default_rng(sum(map(ord, name)))
    return {"1001.rgb": rng.random((3, count, 3), np.float32), "1001.visibility": rng.random((count, 7)).astype("f2")}


def same(a, b):
    return a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) and a[k].dtype == b[k].dtype for k in a)


def make(names):
    return {name: entry(name) for name in names}


def refuse(names):
    raise AssertionError(f"asked to make {names}, which are there")


def test_what_is_there_is_given_back_to_the_last_bit(tmp_path):
    """The second asking makes nothing, and names come in the order they were asked for."""
    first = Cache(tmp_path).get_many(KEYS, make)
    cache = Cache(tmp_path)
    second = cache.get_many(dict(reversed(KEYS.items())), refuse)
    assert list(second) == ["rim", "fill", "key"]
    assert all(same(first[name], second[name]) for name in KEYS)
    assert (cache.hits, cache.misses) == (3, 0)


def test_only_what_is_missing_is_made(tmp_path):
    """One changed light is one key that is not there."""
    Cache(tmp_path).get_many(KEYS, make)
    asked = []

    def note(names):
        asked.extend(names)
        return make(names)

    Cache(tmp_path).get_many(KEYS | {"fill": key_of("fill, brighter")}, note)
    assert asked == ["fill"]


def directory_flipped(path, at):
    """One bit of the archive's directory: the method of packing, the sizes, the names, ..."""
    data = bytearray(path.read_bytes())
    data[data.rfind(b"PK\1\2") + at] ^= 1
    path.write_bytes(data)


def saved(path, **arrays):
    with open(path, "wb") as file:
        np.savez(file, **arrays)


def renamed(path, cache):
    """Another light's entry under this one's name."""
    cache.write(KEYS["rim"], entry("rim"))
    os.replace(cache.path_of(KEYS["rim"]), path)


def claims(path):
    """An archive whose array claims more than any memory holds."""
    import io
    import zipfile

    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": (10**6, 10**9)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("skinbake.contents.npy", head.getvalue())


DAMAGES = {
    **{f"directory {at}": lambda path, cache, at=at: directory_flipped(path, at) for at in (8, 10, 20, 24, 28, 42, 46)},
    "no arrays": lambda path, cache: saved(path),
    "other arrays": lambda path, cache: saved(path, a=np.zeros(3)),
    "same names, other shapes": lambda path, cache: saved(path, **{k: v[:1] for k, v in entry("key").items()}),
    "another's": renamed,
    "objects": lambda path, cache: saved(path, **{"skinbake.contents": np.array([{}], object)}),
    "too large": lambda path, cache: claims(path),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_whatever_is_wrong_with_an_entry_it_counts_as_missing(tmp_path, damage):
    """No error of any library passes, and nothing that was not asked for is given; the next run heals it."""
    cache = Cache(tmp_path)
    cache.get_many({"key": KEYS["key"]}, make)
    DAMAGES[damage](cache.path_of(KEYS["key"]), cache)
    found = cache.get_many({"key": KEYS["key"]}, make)["key"]
    assert same(found, entry("key"))
    assert same(cache.get_many({"key": KEYS["key"]}, refuse)["key"], entry("key"))


def test_a_cache_that_can_only_be_read_is_read(tmp_path, monkeypatch):
    """Its entries are somebody else's, whose times cannot be set: hits all the same, and they stay."""
    Cache(tmp_path).get_many(KEYS, make)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")}

    def refuse_time(*arguments, **options):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "utime", refuse_time)
    cache = Cache(tmp_path)
    assert same(cache.get_many(KEYS, refuse)["rim"], entry("rim"))
    assert cache.hits == 3
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")} == before


def test_an_entry_that_is_a_link_is_not_followed(tmp_path):
    """What it leads to is neither read nor changed; the result takes the link's place."""
    cache = Cache(tmp_path / "cache")
    cache.get_many(KEYS, make)
    path, elsewhere = cache.path_of(KEYS["key"]), tmp_path / "elsewhere.npz"
    os.replace(path, elsewhere)
    path.symlink_to(elsewhere)
    before = elsewhere.read_bytes()
    assert cache.read(KEYS["key"]) is None
    cache.get_many(KEYS, make)
    assert not path.is_symlink()
    assert elsewhere.read_bytes() == before


def test_a_lock_that_is_a_link_ends_the_work(tmp_path):
    """It is not followed, nor worked beside: somebody put it there."""
    (tmp_path / "victim").write_text("precious")
    (tmp_path / "cache" / "locks").mkdir(parents=True)
    (tmp_path / "cache" / "locks" / KEYS["key"]).symlink_to(tmp_path / "victim")
    with pytest.raises(InputError, match="got a symbolic link"):
        Cache(tmp_path / "cache").get_many(KEYS, make)
    assert (tmp_path / "victim").read_text() == "precious"


def test_files_of_others_stay(tmp_path):
    """Only names that a cache gives are ever removed, however old and large."""
    theirs = ["research/measurements.npz", "research/.hidden.npz", "ab/notes.npz", "ab/.x.7.part.npz", "top.npz"]
    for name in theirs:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        saved(tmp_path / name, a=np.zeros(1000))
        os.utime(tmp_path / name, (1e9, 1e9))
    left = tmp_path / "ab" / f".{'0' * 62}.7.part.npz"
    left.touch()
    os.utime(left, (1e9, 1e9))
    Cache(tmp_path, limit_bytes=0).get_many(KEYS, make)
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.npz")) == sorted(theirs)


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "nonsense"])
def test_a_damaged_entry_counts_as_missing(tmp_path, damage):
    """A bit that fell over is seen by its sum; the entry is made anew."""
    cache = Cache(tmp_path)
    cache.get_many({"key": KEYS["key"]}, make)
    path = cache.path_of(KEYS["key"])
    data = bytearray(path.read_bytes())
    if damage == "flipped":
        data[len(data) // 2] ^= 1
    path.write_bytes({"cut": data[: len(data) // 2], "empty": b"", "nonsense": b"PK\3\4 no"}.get(damage, data))
    assert cache.read(KEYS["key"]) is None
    assert same(cache.get_many({"key": KEYS["key"]}, make)["key"], entry("key"))
    assert same(cache.read(KEYS["key"]), entry("key"))


def test_the_longest_unread_goes_first(tmp_path):
    """Past its limit the folder keeps what was read last."""
    cache = Cache(tmp_path)
    cache.get_many(KEYS, make)
    for age, name in enumerate(("key", "fill", "rim")):
        os.utime(cache.path_of(KEYS[name]), (0, 1000 + age))
    assert cache.read(KEYS["key"]) is not None
    size = cache.path_of(KEYS["key"]).stat().st_size
    Cache(tmp_path, limit_bytes=2 * size).prune()
    assert cache.read(KEYS["fill"]) is None
    assert cache.read(KEYS["key"]) is not None
    assert cache.read(KEYS["rim"]) is not None


def _make_slowly(folder: Path, order: list[str], log: str) -> None:
    def made(names):
        time.sleep(0.2)
        with open(log, "a") as file:
            file.write("".join(f"{name}\n" for name in names))
        return make(names)

    found = Cache(folder).get_many({name: KEYS[name] for name in order}, made)
    assert all(same(found[name], entry(name)) for name in order)


def test_each_entry_is_made_once_by_many_processes(tmp_path):
    """Three processes want the same three lights in different orders: nobody waits in a circle, each is traced once."""
    orders = (["key", "fill", "rim"], ["rim", "key", "fill"], ["fill", "rim"])
    context = multiprocessing.get_context("spawn")
    log = tmp_path / "log"
    processes = [context.Process(target=_make_slowly, args=(tmp_path / "cache", o, str(log))) for o in orders]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
        assert process.exitcode == 0
    assert sorted(log.read_text().split()) == ["fill", "key", "rim"]
    assert not list((tmp_path / "cache" / "locks").iterdir())


def test_one_that_fails_leaves_the_work_to_the_next(tmp_path):
    """Who waited for it takes it up."""
    begun = threading.Event()

    def fail(names):
        begun.set()
        time.sleep(0.1)
        raise RuntimeError("no light")

    def first():
        with pytest.raises(RuntimeError):
            Cache(tmp_path).get_many(KEYS, fail)

    thread = threading.Thread(target=first)
    thread.start()
    assert begun.wait(10)
    assert same(Cache(tmp_path).get_many(KEYS, make)["rim"], entry("rim"))
    thread.join()


def test_a_cache_that_cannot_be_written_to_is_done_without(tmp_path):
    """Its folder is a file here; the results come all the same."""
    (tmp_path / "cache").write_text("in the way")
    assert same(Cache(tmp_path / "cache").get_many(KEYS, make)["key"], entry("key"))


def test_the_environment_says_where(tmp_path, monkeypatch):
    """SKINBAKE_CACHE moves every cache to one place."""
    monkeypatch.delenv("SKINBAKE_CACHE", raising=False)
    assert cache_folder(None, tmp_path / "a") == tmp_path / "a"
    assert cache_folder(None) is None
    monkeypatch.setenv("SKINBAKE_CACHE", str(tmp_path / "b"))
    assert cache_folder(None, tmp_path / "a") == tmp_path / "b"
    assert cache_folder(str(tmp_path / "c"), tmp_path / "a") == tmp_path / "c"
    for chosen in ("~nosuchuser/x", "~nosuchuser"):
        monkeypatch.setenv("SKINBAKE_CACHE", chosen)
        with pytest.raises(InputError, match=f"SKINBAKE_CACHE: expected a folder, got '{chosen}'"):
            cache_folder(None, tmp_path)
        with pytest.raises(InputError, match=f"--cache: expected a folder, got '{chosen}'"):
            cache_folder(chosen, tmp_path)
