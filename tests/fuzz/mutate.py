"""Damage to valid files: bytes for binary formats, tokens for text, and the tree itself for YAML."""

from __future__ import annotations

import copy
from random import Random
from typing import Any

import yaml

NUMBERS = (
    b"\x00",
    b"\xff",
    b"\x7f",
    b"\x80",
    b"\xff\xff\xff\xff",
    b"\x00\x00\xc0\x7f",
    b"\x00\x00\x80\x7f",
    b"\xff\xff\xff\x7f",
)
# fmt: off
TOKENS = (
    ".inf", "-.inf", ".nan", "nan", "1e400", "-1", "0", "1e308", "1e-320", "9" * 30, "null", "~", "[]", "{}",
    "[[]]", "on", "no",
    "''", '"', "'", "&a", "*a", "<<: *a", "!!binary AA==", "!!python/object:os.system", "!!timestamp 2001-01-01",
    "!!set {a}",
    "!!float", "!!int x", "? x", ": ", "- ", "|", ">", "%", "@", "`", "\t", "\0", "\ufeff", "\u2028", "1:30:00",
    "0x1F", "0o7", "1_0",
    "${X}", "${HOME}", "${", "~root", "<UDIM>", "/", "..", "//", "999999999", "-0", "1/2/3", "1//1", "f 1 2 3",
    "f -1 -2 -3", "v 0 0 0",
    "vt 0 0", "vn 0 0 1", "usemtl x", "mtllib x.mtl", "o", "g", "s 1", "l 1 2", "#", "\\\n",
)
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**70, 1e308, 1e-320, -0.0, float("inf"), float("-inf"), float("nan"), "", "x",
    "auto", "1", "\0",
    "${X}", "<UDIM>", "~", [], {}, [0], [0, 0, 0], [[]], [{}], {"": 0}, {"path": None}, {0: 1}, {"name": "key"},
    [1, 2], ["a"] * 3, b"\x00",
)
# fmt: on


def damaged_bytes(data: bytes, other: bytes, rng: Random) -> bytes:
    """One to a few dozen flips, inserted runs, cuts and splices with another valid file."""
    out = bytearray(data)
    for _ in range(1 + int(rng.expovariate(0.4))):
        if not out:
            break
        # Headers are where formats break: half of the hits fall on the first 400 bytes
        at = rng.randrange(min(len(out), 400) if rng.random() < 0.5 else len(out))
        kind = rng.randrange(8)
        if kind == 0:
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            out[at] = rng.randrange(256)
        elif kind == 2:
            number = rng.choice(NUMBERS)
            out[at : at + len(number)] = number
        elif kind == 3:
            del out[at : at + 1 + int(rng.expovariate(0.1))]
        elif kind == 4:
            out[at:at] = out[at : at + 1 + int(rng.expovariate(0.05))] * rng.randrange(1, 4)
        elif kind == 5:
            del out[at:]
        elif kind == 6 and other:
            start = rng.randrange(len(other))
            out[at : at + rng.randrange(64)] = other[start : start + rng.randrange(64)]
        else:
            out[at : at + 4] = rng.randbytes(4)
    return bytes(out)


def damaged_text(text: str, rng: Random) -> str:
    """Tokens that mean something somewhere, put where they do not belong; lines moved, doubled and lost."""
    for _ in range(1 + int(rng.expovariate(0.6))):
        lines = text.split("\n")
        at = rng.randrange(len(text) + 1)
        kind = rng.randrange(6)
        if kind == 0:
            text = text[:at] + rng.choice(TOKENS) + text[at:]
        elif kind == 1:
            text = text[:at] + rng.choice(TOKENS) + text[at + rng.randrange(1, 12) :]
        elif kind == 2:
            text = text[:at] + text[at + 1 + int(rng.expovariate(0.2)) :]
        elif kind == 3:
            words = text.split(" ")
            words[rng.randrange(len(words))] = rng.choice(TOKENS)
            text = " ".join(words)
        else:
            i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
            if kind == 4:
                lines[i], lines[j] = lines[j], lines[i]
            else:
                lines.insert(i, lines[j] if rng.random() < 0.7 else " " * rng.randrange(6) + rng.choice(TOKENS))
            text = "\n".join(lines)
    return text


def damaged_tree(tree: Any, rng: Random) -> Any:
    """A few values, keys or items of a parsed file replaced, moved, doubled or lost."""
    tree = copy.deepcopy(tree)
    for _ in range(1 + int(rng.expovariate(0.7))):
        holders = list(_holders(tree))
        if not holders:
            return rng.choice(VALUES)
        holder, key = rng.choice(holders)
        _, another = holder, rng.choice(holders)
        kind = rng.randrange(5)
        if kind <= 1:
            holder[key] = copy.deepcopy(rng.choice(VALUES))
        elif kind == 2:
            del holder[key]
        elif kind == 3:
            holder[key] = copy.deepcopy(another[0][another[1]])
        elif isinstance(holder, dict):
            holder[rng.choice([another[1], "x", "name", "path", "model", str(key) + "_", 7, None])] = holder.pop(key)
        else:
            holder.append(copy.deepcopy(holder[key]))
    return tree


def _holders(value: Any) -> Any:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in items:
        yield value, key
        yield from _holders(child)


def damaged_yaml(text: str, rng: Random) -> str:
    """Half the time the tree, else the text."""
    if rng.random() < 0.5:
        return yaml.safe_dump(
            damaged_tree(yaml.safe_load(text), rng), default_flow_style=rng.choice([None, True, False])
        )
    return damaged_text(text, rng)
