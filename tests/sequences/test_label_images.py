"""Label images as people have them: mapped with, or left out with one sentence; never a traceback."""

import cv2
import numpy as np
import pytest
from PIL import Image
from sequence_files import write_tum

from dsmap.classes import CLASS_NAMES, NYU40_TO_13
from dsmap.errors import InputError, InputWarning
from dsmap.sequences import Sequence, open_sequence
from dsmap.sequences.label_check import check_all_labels

IDS = (np.arange(48)[:, None] // 4 % 13 + 1 + np.zeros((1, 64), int)).astype(np.uint8)
COLOURS = np.random.default_rng(3).integers(0, 255, (256, 3), dtype=np.uint8)


def recording(folder, save, suffix=".png"):
    """A recording whose label images `save(file, k)` writes."""
    write_tum(folder, labels=True)
    lines = (folder / "label.txt").read_text().splitlines()
    rows = [line.split() for line in lines if not line.startswith("#")]
    for k, (_, name) in enumerate(rows):
        (folder / name).unlink()
        save((folder / name).with_suffix(suffix), k)
    (folder / "label.txt").write_text("".join(f"{t} {n.removesuffix('.png') + suffix}\n" for t, n in rows))
    return folder


def save(pixels):
    return lambda file, _: cv2.imwrite(str(file), pixels)


def palette(file, _):
    image = Image.fromarray(IDS, "P")
    image.putpalette(COLOURS.tobytes())
    image.save(file)


def same_labels(sequence: Sequence, expected) -> bool:
    return all(np.array_equal(sequence.frame(i).label, expected) for i in range(len(sequence)))


@pytest.mark.parametrize(
    "write",
    [save(IDS), save(IDS.astype(np.uint16)), save(np.repeat(IDS[..., None], 3, 2)), palette],
    ids=["8 bit", "16 bit", "grey in three channels", "palette"],
)
def test_ids_of_the_13_classes_are_read_however_they_are_stored(tmp_path, write):
    sequence = open_sequence(recording(tmp_path / "r", write))
    assert sequence.has_labels and not sequence.notes and same_labels(sequence, IDS)


@pytest.mark.parametrize(("dtype", "void"), [(np.uint8, 255), (np.uint16, 65535), (np.uint16, 255)])
def test_255_and_65535_are_void(tmp_path, dtype, void):
    stored = np.where(IDS == 3, void, IDS).astype(dtype)
    sequence = open_sequence(recording(tmp_path / "r", save(stored)))
    assert same_labels(sequence, np.where(IDS == 3, 0, IDS))


@pytest.mark.parametrize(
    ("write", "said", "suffix"),
    [
        (save(IDS + 20), "found the ids 21, 22, 23", ".png"),
        (save(IDS.astype(np.uint16) * 1000 + 7), "found the ids 1007, 2007", ".png"),
        (save(IDS.astype(np.uint16) + 256), "found the ids 257", ".png"),
        (save(COLOURS[IDS]), "found the colours #", ".png"),
        (save(IDS), "JPEG", ".jpg"),
        (lambda file, _: Image.fromarray(IDS).save(file, quality=80), "lossy WebP", ".webp"),
        (lambda file, _: Image.fromarray(IDS).save(file), "GIF", ".gif"),
        (save(IDS[:, ::2]), "32x48", ".png"),
        (lambda file, _: file.write_bytes(b"nothing"), "does not decode", ".png"),
        (lambda file, _: None, "none of the label images exists", ".png"),
    ],
    ids=[
        "other ids",
        "instances",
        "16 bit",
        "colours",
        "jpeg",
        "webp",
        "gif",
        "another view",
        "damaged",
        "missing",
    ],
)
def test_labels_that_cannot_be_used_are_left_out_with_a_sentence(tmp_path, write, said, suffix):
    folder = recording(tmp_path / "r", write, suffix)
    sequence = open_sequence(folder)
    assert not sequence.has_labels and len(list(sequence)) == 6 and not sequence.skipped
    assert sequence.recording.labels_unused is not None and said in sequence.recording.labels_unused
    assert sequence.recording.labels_unused in sequence.notes


def test_a_frame_without_its_label_image_is_mapped_without(tmp_path):
    some = lambda file, k: cv2.imwrite(str(file), IDS) if k % 3 else None  # noqa: E731
    sequence = open_sequence(recording(tmp_path / "r", some))
    assert any(note.startswith("2 of 6 label images are missing") for note in sequence.notes)
    assert [f.label is not None for f in sequence] == [False, True, True] * 2


def test_a_foreign_id_that_no_sample_shows_is_warned_of(tmp_path):
    folder = recording(tmp_path / "r", save(IDS))
    sequence = open_sequence(folder)
    cv2.imwrite(str(sorted((folder / "label").iterdir())[2]), IDS + 20)
    with pytest.warns(InputWarning, match="frame 2 has no labels: .*found the ids 21"):
        frames = list(sequence)
    assert len(frames) == 6 and frames[2].label is None and frames[3].label is not None


def test_labels_that_are_to_be_fused_are_all_looked_into(tmp_path):
    folder = recording(tmp_path / "r", save(IDS))
    check_all_labels(sequence := open_sequence(folder))
    cv2.imwrite(str(sorted((folder / "label").iterdir())[4]), IDS + 20)
    with pytest.raises(InputError, match="found the ids 21, 22"):
        check_all_labels(sequence)


def test_labels_of_another_size_are_brought_to_the_images(tmp_path):
    sequence = open_sequence(recording(tmp_path / "r", save(IDS[::2, ::2])))
    assert sequence.has_labels and any("64x48" in note for note in sequence.notes)
    assert same_labels(sequence, IDS)


NAMED = "".join(f"{i + 20}: {CLASS_NAMES[i]}\n" for i in range(1, 14))
CODED = "".join(f"{r} {g} {b} {CLASS_NAMES[i]}\n" for i, (r, g, b) in enumerate(COLOURS[:14].tolist()) if i)
LISTED = "[" + ",".join(f'{{"id": {i + 20}, "name": "{CLASS_NAMES[i]}"}}' for i in range(1, 14)) + "]"


@pytest.mark.parametrize(
    ("write", "name", "text"),
    [
        (save(IDS + 20), "map.yaml", NAMED),
        (save(IDS + 20), "map.json", LISTED),
        (save(IDS + 20), "map.csv", "id,class\n" + NAMED.replace(": ", ",")),
        (save(IDS + 20), "map.txt", NAMED.replace(":", "")),
        (save(COLOURS[IDS][..., ::-1]), "map.txt", CODED),
        (palette, "map.txt", CODED),
    ],
)
def test_a_file_says_what_ids_and_colours_mean(tmp_path, write, name, text):
    (tmp_path / name).write_text(text)
    sequence = open_sequence(recording(tmp_path / "r", write), label_map=str(tmp_path / name))
    assert sequence.has_labels and same_labels(sequence, IDS)


def test_nyu40_and_scannet(tmp_path):
    stored = (np.arange(48 * 64).reshape(48, 64) % 41).astype(np.uint8)
    folder = recording(tmp_path / "r", save(stored))
    assert same_labels(open_sequence(folder, label_map="nyu40"), NYU40_TO_13[stored])
    with pytest.raises(InputError, match="needs scannetv2-labels.combined.tsv"):
        open_sequence(folder, label_map="scannet")
    rows = "".join(f"{i}\tx\t{i}\n" for i in range(41))
    (tmp_path / "scannetv2-labels.combined.tsv").write_text("id\traw_category\tnyu40id\n" + rows)
    assert same_labels(open_sequence(folder, label_map="scannet"), NYU40_TO_13[stored])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3: chiar\n", "found the class 'chiar', expected 'chair'"),
        ("3: 14\n", "found the class '14'"),
        ("sky: chair\n", "found 'sky', expected an id"),
        ("nothing", "expected `id: class` pairs"),
        ("[{a: 1}]", "expected id"),
    ],
)
def test_a_wrong_label_map_is_one_sentence(tmp_path, text, said):
    (tmp_path / "map.yaml").write_text(text)
    folder = recording(tmp_path / "r", save(IDS))
    with pytest.raises(InputError, match=said):
        open_sequence(folder, label_map=str(tmp_path / "map.yaml"))
    with pytest.raises(InputError, match="--label-map foo: no such file, expected nyu40, scannet or a file"):
        open_sequence(folder, label_map="foo")
