"""From a `--segmenter` word to the segmenter itself, for every command that needs one."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import tyro

from dsmap.errors import InputError
from dsmap.fusion.labels.semantics import GroundTruthSegmenter, LabelNoise
from dsmap.fusion.segmenter import Segmenter
from dsmap.ranges import Seed, Share
from dsmap.tools.support.user_code import made_by


@dataclass
class SegmenterSpec:
    """Where class probabilities come from; written into a run's config.yaml."""

    kind: Annotated[str, tyro.conf.arg(name="segmenter")] = "dsnet"
    """What labels frames: dsnet (the network), labels (the recording's own), none, or module:factory returning a
    segmenter."""
    weights: str | None = None
    """Weights of the network: a file, or one that comes with dsmap: dsnet-p (default; colour and geometry) or dsnet
    (the paper's, small, colour alone)."""
    label_noise: Share = 0.0
    """Corrupt this share of the recording's own labels (a test of label fusion)."""
    label_noise_kind: LabelNoise = "pixels"
    """How labels are corrupted: pixels: each alone; blobs: 20 px patches drawn anew a frame; confusion: chair becomes
    sofa."""
    seed: Seed = 0
    """Seed of label corruption."""
    engine: Literal["auto", "torch", "onnx"] = "auto"
    """What runs the network: torch, onnx (ONNX Runtime, CPU), or auto: the faster one that is installed."""
    prior: Share | None = None
    """Class prior of the network's answers: 0 as frequent as in its training data (most pixels right), 1 all classes
    alike (best average over classes); without it as the weights say."""


def names_code(kind: Any) -> bool:
    """Whether a `--segmenter` word is module:factory: code that would be run."""
    return isinstance(kind, str) and ":" in kind


def make_segmenter(spec: SegmenterSpec, device: str = "cpu", code: bool = False) -> Segmenter | None:
    """Build the segmenter that a spec names; None for `none`.

    Args:
        code: whether it may be module:factory. Only the command line may name code, no file.

    Raises:
        InputError: an unknown name, a factory that is not there, foreign weights.
    """
    if spec.kind == "none":
        return None
    if spec.kind == "labels":
        if not 0 <= spec.label_noise <= 1:
            raise InputError(f"--label-noise is {spec.label_noise}; expected a share between 0 and 1")
        return GroundTruthSegmenter(spec.label_noise, spec.label_noise_kind, spec.seed)
    if spec.kind == "dsnet":
        from dsmap.dsnet.inference.predict import load_segmenter

        return load_segmenter(spec.weights, device, spec.engine, spec.prior)
    if not names_code(spec.kind):
        raise InputError(f"--segmenter is {spec.kind!r}; expected dsnet, labels, none or module:factory")
    if not code:
        raise InputError(
            f"a file names the code {spec.kind} as its segmenter; expected --segmenter {spec.kind} on the command line"
        )
    return made_by(spec.kind, "--segmenter", "a segmenter")
