"""What runs a trained network on one image: torch, or ONNX Runtime, which is faster on a CPU."""

import importlib.util
from typing import Any, Literal, Protocol, get_args

import numpy as np
import torch
from torch import Tensor, nn

from dsmap.dsnet.checkpoint import WeightsInfo
from dsmap.dsnet.networks.dsnet import DSNet, fold_batch_norms, to_input
from dsmap.dsnet.networks.dsnet_p import DSNetP
from dsmap.errors import InputError

EngineName = Literal["auto", "torch", "onnx"]
"""auto: ONNX Runtime on a CPU where it is installed, else torch."""
_NEEDED = ("onnx", "onnxruntime")


class Engine(Protocol):
    """A network that answers one image of its working size."""

    name: str

    def probabilities(self, rgb: np.ndarray, geometry: np.ndarray | None) -> np.ndarray:
        """Calibrated probabilities, float32, shape (H / 2, W / 2, classes), C-contiguous, the caller's own.

        Args:
            rgb: uint8 (H, W, 3).
            geometry: (H, W, 4) of `kernels.geometry`; given for RGB-D networks, and only for these.
        """
        ...


class TorchEngine:
    """The network in torch: batch norms folded, channels_last, on CUDA as a captured graph."""

    name = "torch"

    def __init__(self, model: nn.Module, info: WeightsInfo, device: torch.device):
        self.info = info
        self.device = device
        folded = fold_batch_norms(model).to(device)
        self.model: nn.Module = folded.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.forward: Any = self.model
        if device.type == "cuda":
            from dsmap.dsnet.inference.cuda_graph import CapturedNet

            self.forward = CapturedNet(self.model, info)

    @torch.inference_mode()
    def logits(self, rgb: Tensor, geometry: Tensor | None = None) -> Tensor:
        """Logits at the wanted prior, before the temperature, float32 (1, classes, H / 2, W / 2), on the device.

        Args:
            rgb: uint8 (H, W, 3), on any device.
            geometry: (H, W, 4).
        """
        images = rgb[None].to(self.device)
        x = to_input(images, None if geometry is None else geometry[None].to(self.device))
        return self.forward(x) + torch.from_numpy(self.info.offset()).to(self.device)[:, None, None]

    @torch.inference_mode()
    def softmax(self, rgb: Tensor, geometry: Tensor | None = None) -> Tensor:
        """Calibrated probabilities, float32 (H / 2, W / 2, classes), contiguous, on the engine's device."""
        scaled = self.logits(rgb, geometry) / self.info.temperature
        return torch.softmax(scaled, dim=1)[0].permute(1, 2, 0).contiguous()

    def probabilities(self, rgb: np.ndarray, geometry: np.ndarray | None) -> np.ndarray:
        small = None if geometry is None else torch.from_numpy(geometry)
        return self.softmax(torch.from_numpy(rgb), small).cpu().numpy()


class OnnxEngine:
    """The network in ONNX Runtime on the CPU; its graph is built in memory, which takes a fraction of a second."""

    name = "onnx"

    def __init__(self, model: nn.Module, info: WeightsInfo):
        self._model, self._info = model, info
        self._sessions: dict[tuple[int, int], Any] = {}
        self._session(info.size)

    def _session(self, size: tuple[int, int]) -> Any:
        """The session of this image size; its graph is built when the first image of that size comes."""
        from dsmap.dsnet.inference.onnx_export import build_onnx

        if size not in self._sessions:
            graph = build_onnx(self._model, self._info, size, unpool="blocked")
            self._sessions[size] = onnx_session(graph.SerializeToString())
        return self._sessions[size]

    def probabilities(self, rgb: np.ndarray, geometry: np.ndarray | None) -> np.ndarray:
        inputs = {"image": rgb[None]}
        if geometry is not None:
            inputs["geometry"] = geometry[None].astype(np.float32, copy=False)
        return self._session((rgb.shape[1], rgb.shape[0])).run(None, inputs)[0][0]


def onnx_session(graph: bytes) -> Any:
    """An ONNX Runtime session on as many threads as torch uses (so OMP_NUM_THREADS counts for both)."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    options.log_severity_level = 3
    # Its threads must not spin on while the mapper works on the same cores.
    options.add_session_config_entry("session.force_spinning_stop", "1")
    # Folding would take the constants of the `blocked` form out of the layout that it is there for.
    return onnxruntime.InferenceSession(
        graph, options, providers=["CPUExecutionProvider"], disabled_optimizers=["ConstantFolding"]
    )


def has_onnx() -> bool:
    """Whether the packages of the ONNX engine are installed."""
    return all(importlib.util.find_spec(package) is not None for package in _NEEDED)


def choose_engine(name: str, model: nn.Module, device: torch.device) -> str:
    """`torch` or `onnx`.

    Raises:
        InputError: an unknown name, or an engine that cannot be had here.
    """
    if name not in get_args(EngineName):
        raise InputError(f"engine is {name!r}, expected one of: {', '.join(get_args(EngineName))}")
    fits = isinstance(model, DSNet | DSNetP) and device.type == "cpu"
    if name == "auto":
        return "onnx" if fits and has_onnx() else "torch"
    if name == "onnx" and not fits:
        raise InputError(f"engine onnx on {device.type}: it runs DS-Nets on the CPU, expected engine torch")
    if name == "onnx" and not has_onnx():
        raise InputError("engine onnx needs onnx and onnxruntime, expected pip install 'dsmap[dsnet]'")
    return name
