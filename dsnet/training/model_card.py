"""What a weights file is made of and how it validated, as a page for people."""

import json

from dsmap.dsnet.checkpoint import WeightsInfo


def model_card(info: WeightsInfo, name: str, licence: str | None = None) -> str:
    """The model card of a weights file, Markdown; what its header does not hold is said to be unknown.

    Args:
        licence: what is said of the data's terms; None: what the header says.
    """
    notes = info.notes
    validation = notes.get("validation", {})
    lines = [
        f"# {name}",
        "",
        f"- Network: {info.config}",
        f"- Input: {info.size[0]}x{info.size[1]}; classes: {', '.join(info.class_names[1:])}",
        f"- Temperature: {info.temperature:.3f}",
        *_prior(info),
        f"- Licence: {licence or notes.get('licence') or 'nothing stated'}",
        "",
        "## Training",
        "",
    ]
    for number, stage in enumerate([*notes.get("stages", []), notes], start=1):
        lines += _stage(number, stage)
    lines += ["", "## Validation", ""]
    if not validation:
        return "\n".join([*lines, "Not recorded.", ""])
    figures = {"class_avg": "class average", "miou": "mIoU", "pixel_acc": "pixel accuracy", "ece": "ECE"}
    shown = [f"{text} {100 * validation[key]:.1f} %" for key, text in figures.items() if key in validation]
    lines += [f"On `{notes.get('val', 'unknown')}`, step {validation.get('step')}: {', '.join(shown)}.", ""]
    lines += ["| class | share of the training pixels [%] | recall [%] | IoU [%] |", "|---|---|---|---|"]
    shares = dict(zip(info.class_names, info.shares, strict=False))
    for label, values in validation.get("per_class", {}).items():
        share = f"{100 * shares[label]:.1f}" if label in shares else "unknown"
        lines.append(f"| {label} | {share} | {100 * values['recall']:.1f} | {100 * values['iou']:.1f} |")
    if notes.get("priors"):
        lines += ["", "At other class priors (`--prior`; the temperature is the same):", ""]
        lines += [f"| prior | {' | '.join(figures.values())} |", "|---|" + "---|" * len(figures)]
        for prior, found in notes["priors"].items():
            lines.append(f"| {prior} | {' | '.join(f'{100 * found[key]:.1f}' for key in figures)} |")
    return "\n".join([*lines, ""])


def _prior(info: WeightsInfo) -> list[str]:
    if not info.shares:
        return []
    return [f"- Class prior: {info.prior:g} (0: as frequent as in the training data, 1: all classes alike)"]


def _stage(number: int, stage: dict) -> list[str]:
    """One stage of the training as lines of a list."""
    data = ", ".join(stage.get("data", [])) or "unknown data"
    lines = [f"{number}. {stage.get('images', '?')} images of {data}"]
    if stage.get("command"):
        lines.append(f"   - Command: `{stage['command']}`")
    if stage.get("seconds"):
        rate = stage.get("images_per_second", 0)
        lines.append(
            f"   - {stage['seconds']:.0f} s in all, {rate:.1f} images/s (validation included), "
            f"{stage.get('processes', 1)} process(es) on {stage.get('device', 'unknown')}"
        )
    for part in ("train", "augment"):
        if part in stage:
            lines.append(f"   - {part}: `{json.dumps(stage[part])}`")
    return lines
