"""Weights and training checkpoints on disk: safetensors with a JSON header, never pickle."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import safetensors
import torch
from torch import Tensor, nn

from dsmap.classes import CLASS_NAMES
from dsmap.dsnet.config import DeconvNetConfig, DSNetConfig, DSNetPConfig, NetConfig
from dsmap.dsnet.networks.build import build_network
from dsmap.errors import InputError
from dsmap.files import as_read_back
from dsmap.tensor_files import write_tensors

SHIPPED = {name: Path(__file__).parent / "weights" / f"{name}.safetensors" for name in ("dsnet-p", "dsnet")}
"""Weights that come with dsmap; wherever a file is asked for, the name does."""
DEFAULT = "dsnet-p"
REPLACED = {"dsnet-l": "dsnet-p", "dsnet-photos": "dsnet", "dsnet-l-photos": "dsnet-p"}
"""Names of earlier versions and what took their place."""
WEIGHTS_FORMAT = "dsmap.dsnet"
TRAINING_FORMAT = "dsmap.dsnet.training"
_KINDS: dict[str, type] = {
    "dsnet": DSNetConfig,
    "dsnet-p": DSNetPConfig,
    "deconvnet": DeconvNetConfig,
}
"""`kind` in a header to the class of its configuration; a header without it is of a DS-Net."""


@dataclass
class WeightsInfo:
    """What a weights file says about itself."""

    config: NetConfig
    size: tuple[int, int] = (448, 448)
    """Width and height [px] a frame is resized to before the network sees it."""
    temperature: float = 1.0
    """Logits are divided by it before the softmax (calibrated on the validation set)."""
    class_names: tuple[str, ...] = CLASS_NAMES
    prior: float = 0.0
    """Class prior of the probabilities: 0 as frequent as in the training data, 1 all alike."""
    shares: tuple[float, ...] = ()
    """How frequent each class was in the training data, void 0; (): unknown, and `prior` has no effect."""
    balance: tuple[float, ...] = ()
    """Weight of each class in the training's loss."""
    notes: dict = field(default_factory=dict)
    """How it was trained and how it validated; for people, read by nothing."""

    def trained_prior(self) -> np.ndarray:
        """Class prior of the network's raw logits: share times loss weight, shape (classes,), 0 where never seen."""
        if not self.shares:
            return np.zeros(len(self.class_names))
        return np.array(self.shares) * np.array(self.balance)

    def offset(self) -> np.ndarray:
        """What is added to the logits for the wanted prior (Menon et al. 2021), float32, shape (classes,).

        The network gives logits of a posterior whose prior is q = `trained_prior`; the wanted prior is
        share^(1 - prior): offset = (1 - prior) log share - log q. Classes never seen have 0.
        """
        share = np.array(self.shares or np.zeros(len(self.class_names)))
        seen = share > 0
        found = np.zeros(len(share), np.float32)
        if seen.any():
            found[seen] = (1 - self.prior) * np.log(share[seen]) - np.log(self.trained_prior()[seen])
            found[seen] -= (share[seen] * found[seen]).sum()  # void is where it was
        return found


def save_tensors(path: Path, tensors: dict[str, Tensor], file_format: str, header: dict) -> None:
    """Write a safetensors file atomically; `header` is stored as JSON beside the format marker."""
    arrays = {name: tensor.detach().cpu().contiguous().numpy() for name, tensor in tensors.items()}
    write_tensors(path, arrays, {"format": file_format, "header": json.dumps(header)})


def load_tensors(path: Path, file_format: str) -> tuple[dict[str, Tensor], dict]:
    """Read what `save_tensors` wrote.

    Raises:
        InputError: missing, damaged, or of another format.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a {file_format} safetensors file")
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") != file_format:
                found = metadata.get("format", "none")
                raise InputError(f"{path}: format marker is {found!r}, expected {file_format!r}")
            header = json.loads(metadata["header"])
            # A copy of the mapped file: the training loop rewrites its own checkpoint.
            return {name: file.get_tensor(name).clone() for name in file.keys()}, header  # noqa: SIM118
    except (safetensors.SafetensorError, KeyError, ValueError) as error:
        raise InputError(f"{path}: not a readable safetensors file of {file_format} ({error})") from error


def save_weights(path: Path, model: nn.Module, info: WeightsInfo) -> None:
    """Write a network that `load_weights` and `dsmap map --weights` read."""
    header = {**asdict(info), "config": record_of(info.config)}
    save_tensors(path, model.state_dict(), WEIGHTS_FORMAT, header)


def load_weights(
    path: Path | str, class_names: tuple[str, ...] | None = CLASS_NAMES
) -> tuple[nn.Module, WeightsInfo]:
    """Read a network for inference (in eval mode, on the CPU).

    Args:
        path: the file, or a name of `SHIPPED`.
        class_names: classes that it must have; None: any.

    Raises:
        InputError: missing, damaged or foreign file, unknown configuration, other classes.
    """
    if str(path) in REPLACED and not Path(path).is_file():
        raise InputError(
            f"weights {path}: no longer ship, expected {REPLACED[str(path)]}, which took their place"
        )
    path = Path(path)
    if not path.is_file():
        path = SHIPPED.get(str(path), path)
    tensors, header = load_tensors(path, WEIGHTS_FORMAT)
    try:
        info = WeightsInfo(
            config=config_from(header["config"]),
            size=(int(header["size"][0]), int(header["size"][1])),
            temperature=float(header["temperature"]),
            class_names=tuple(header["class_names"]),
            prior=float(header.get("prior", 0.0)),
            shares=tuple(float(value) for value in header.get("shares", ())),
            balance=tuple(float(value) for value in header.get("balance", ())),
            notes=dict(header["notes"]),
        )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"{path}: unknown {WEIGHTS_FORMAT} header ({error!r})") from error
    if class_names is not None and info.class_names != class_names:
        raise InputError(f"{path}: classes are {list(info.class_names)}, expected {list(class_names)}")
    if any(side < 32 or side % 32 for side in info.size) or not info.temperature > 0:
        raise InputError(
            f"{path}: size {info.size} and temperature {info.temperature}, expected multiples of 32 and > 0"
        )
    if info.shares and not len(info.shares) == len(info.balance) == len(info.class_names):
        raise InputError(
            f"{path}: shares and balance of other classes, expected {len(info.class_names)} of each"
        )
    model = build_network(info.config)
    load_state(model, tensors, path)
    return model.eval(), info


def load_state(model: torch.nn.Module, tensors: dict[str, Tensor], path: Path) -> None:
    """`load_state_dict` whose mismatch is the file's fault."""
    try:
        model.load_state_dict(tensors)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: tensors do not fit the network it describes ({reason[:200]})") from error


def record_of(config: NetConfig) -> dict:
    """The JSON form of a network's configuration."""
    kind = next(kind for kind, form in _KINDS.items() if isinstance(config, form))
    record = as_read_back(asdict(config))
    return record if kind == "dsnet" else {"kind": kind, **record}


def config_from(record: dict) -> NetConfig:
    """A network's configuration from its JSON form."""
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in record.items()}
    kind = str(values.pop("kind", "dsnet"))
    if kind == "dsnet" and "widths" not in values:
        raise KeyError("widths")
    return _KINDS[kind](**values)
