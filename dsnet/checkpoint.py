"""Weights and training checkpoints on disk: safetensors with a JSON header, never pickle."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from dsmap.classes import CLASS_NAMES
from dsmap.config_file import fill
from dsmap.dsnet.config import DeconvNetConfig, DSNetConfig, DSNetPConfig, NetConfig
from dsmap.dsnet.networks.build import build_network
from dsmap.errors import InputError
from dsmap.files import as_read_back
from dsmap.plain import brief, parse_json
from dsmap.reading import reading
from dsmap.sealed import read_words
from dsmap.tensor_files import write_tensors

SHIPPED = {name: Path(__file__).parent / "weights" / f"{name}.safetensors" for name in ("dsnet-p", "dsnet")}
"""Weights that come with dsmap; wherever a file is asked for, the name does."""
DEFAULT = "dsnet-p"
REPLACED = {"dsnet-l": "dsnet-p", "dsnet-photos": "dsnet", "dsnet-l-photos": "dsnet-p"}
"""Names of earlier versions and what took their place."""
_SEALED = "/2"
"""Ends the names of formats with a checksum; those without are older."""
WEIGHTS_FORMAT = f"dsmap.dsnet{_SEALED}"
TRAINING_FORMAT = f"dsmap.dsnet.training{_SEALED}"
_MAX_SIDE = 4096
"""Of a network's working size [px]."""
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
    expected = f"a readable safetensors file of {file_format}"
    formats = (file_format, file_format.removesuffix(_SEALED))
    words = read_words(path, expected, formats, is_trusted=path in SHIPPED.values())
    header = parse_json(words.get("header", ""), f"{path}: unknown header", expected)
    if not isinstance(header, dict):
        raise InputError(f"{path}: unknown header {brief(header)}, expected {expected}")
    with reading(path, expected, SafetensorError), safe_open(path, framework="pt") as file:
        # A copy of the mapped file: the training loop rewrites its own checkpoint.
        return {name: file.get_tensor(name).clone() for name in file.keys()}, header  # noqa: SIM118


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
    info = _info(path, header)
    if class_names is not None and info.class_names != class_names:
        raise InputError(f"{path}: classes are {list(info.class_names)}, expected {list(class_names)}")
    odd = next((name for name, tensor in tensors.items() if not torch.isfinite(tensor).all()), None)
    if odd is not None:
        raise InputError(f"{path}: {odd} holds numbers that are none, expected finite weights")
    with torch.device("meta"):  # costs no memory: sizes are compared before any is asked for
        shapes = {
            name: tuple(tensor.shape) for name, tensor in build_network(info.config).state_dict().items()
        }
    found = {name: tuple(tensor.shape) for name, tensor in tensors.items()}
    if found != shapes:
        name = min(name for name in found.keys() | shapes.keys() if found.get(name) != shapes.get(name))
        raise InputError(
            f"{path}: tensors do not fit the network it describes ({name} is {found.get(name)}), expected "
            f"{shapes.get(name)}"
        )
    model = build_network(info.config)
    load_state(model, tensors, path)
    return model.eval(), info


def _info(path: Path, header: dict) -> WeightsInfo:
    """What a header says. Raises InputError: not that of a network of dsmap."""
    with reading(f"{path}: unknown {WEIGHTS_FORMAT} header", "that of a network of dsmap"):
        names = header["class_names"]
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise TypeError(f"class_names {brief(names)}")
        info = WeightsInfo(
            config=config_from(header["config"], str(path)),
            size=(_whole(header["size"][0]), _whole(header["size"][1])),
            temperature=float(header["temperature"]),
            class_names=tuple(names),
            prior=float(header.get("prior", 0.0)),
            shares=tuple(float(value) for value in header.get("shares", ())),
            balance=tuple(float(value) for value in header.get("balance", ())),
            notes=dict(header["notes"]),
        )
    if len(info.size) != 2 or any(not 32 <= side <= _MAX_SIDE or side % 32 for side in info.size):
        raise InputError(f"{path}: size {info.size}, expected multiples of 32 up to {_MAX_SIDE}")
    if not 0 < info.temperature < np.inf or not 0 <= info.prior <= 1:
        raise InputError(
            f"{path}: temperature {info.temperature} and prior {info.prior}, expected > 0 and 0 to 1"
        )
    if info.config.classes != len(names):
        raise InputError(f"{path}: classes are {brief(names)}, expected {info.config.classes} of them")
    if info.shares and not len(info.shares) == len(info.balance) == len(info.class_names):
        raise InputError(
            f"{path}: shares and balance of other classes, expected {len(info.class_names)} of each"
        )
    if not all(0 <= value < np.inf for value in (*info.shares, *info.balance)):
        raise InputError(f"{path}: shares or balance below 0 or infinite, expected numbers from 0")
    return info


def _whole(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{brief(value)} for a whole number")
    return value


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


def config_from(record: dict, where: str = "network") -> NetConfig:
    """A network's configuration from its JSON form. Raises InputError: there is no such network."""
    if not isinstance(record, dict):
        raise InputError(f"{where}: found {brief(record)}, expected a network's configuration")
    values = dict(record)
    kind = values.pop("kind", "dsnet")
    if kind not in _KINDS or (kind == "dsnet" and "widths" not in values):
        raise InputError(f"{where}: unknown network {brief(record)}, expected one of {', '.join(_KINDS)}")
    return fill(_KINDS[kind](), values, f"{where}: config")
