"""Damage to the numbers, words and lines of a text file."""

import re
from pathlib import Path

from damage_common import NUMBERS, TEXT, NotApplicable, Rng, read, write


def text_of(path: Path) -> str:
    data = read(path)
    if path.suffix.lower() not in TEXT and (b"\0" in data or len(data) > 200_000 or path.suffix):
        raise NotApplicable
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise NotApplicable from None


def number(rng: Rng, path: Path) -> None:
    """One number is another word."""
    text = text_of(path)
    found = list(re.finditer(r"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", text))
    if not found:
        raise NotApplicable
    one = found[int(rng.integers(len(found)))]
    write(path, text[: one.start()] + str(rng.choice(NUMBERS)) + text[one.end() :])


def all_numbers_of_a_column(rng: Rng, path: Path) -> None:
    lines, column, word = text_of(path).split("\n"), int(rng.integers(5)), str(rng.choice(NUMBERS))
    split = [line.split(" ") for line in lines]
    for words in split:
        if len(words) > column and words[0][:1] != "#":
            words[column] = word
    write(path, "\n".join(" ".join(words) for words in split))


def lines(rng: Rng, path: Path) -> None:
    """Lines are lost, doubled, exchanged, or in another order."""
    found = text_of(path).split("\n")
    if len(found) < 2:
        raise NotApplicable
    i, j = (int(k) for k in rng.integers(len(found), size=2))
    match int(rng.integers(5)):
        case 0:
            del found[i]
        case 1:
            found.insert(i, found[j])
        case 2:
            found[i], found[j] = found[j], found[i]
        case 3:
            rng.shuffle(found)
        case _:
            found = found * 3
    write(path, "\n".join(found))


def fields(rng: Rng, path: Path) -> None:
    """Words of a line are lost, doubled or exchanged."""
    found = text_of(path).split("\n")
    i = int(rng.integers(len(found)))
    words = found[i].split(" ")
    if len(words) < 2:
        raise NotApplicable
    a, b = (int(k) for k in rng.integers(len(words), size=2))
    match int(rng.integers(4)):
        case 0:
            del words[a]
        case 1:
            words.insert(a, words[b])
        case 2:
            words[a], words[b] = words[b], words[a]
        case _:
            words[a] = ""
    found[i] = " ".join(words)
    write(path, "\n".join(found))


def characters(rng: Rng, path: Path) -> None:
    """A character that does not belong there; another encoding; endless lines."""
    text = text_of(path)
    at = int(rng.integers(len(text) + 1))
    match int(rng.integers(8)):
        case 0:
            text = text[:at] + "\0" + text[at:]
        case 1:
            text = text[:at] + "☃\u202e\ufeff" + text[at:]
        case 2:
            write(path, text.encode("utf-16"))
            return
        case 3:
            text = text[:at] + "9" * 100_000 + text[at:]
        case 4:
            text = text.replace("\n", "\r\n")
        case 5:
            text = text.replace("\n", " ")
        case 6:
            text = text[:at] + "\t:{[&*!%@`" + text[at:]
        case _:
            write(path, text[:at].encode() + b"\xff\xfe\xc3" + text[at:].encode())
            return
    write(path, text)
