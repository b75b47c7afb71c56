"""CUDA only: a network's kernels recorded once and replayed as one launch. Not run yet on a GPU."""

import torch
from torch import Tensor, nn

from dsmap.dsnet.checkpoint import WeightsInfo

_WARM_UP = 3


class CapturedNet:
    """A network of one input size as a CUDA graph; runs eagerly where capture fails.

    The result is overwritten by the next call.
    """

    def __init__(self, model: nn.Module, info: WeightsInfo):
        width, height = info.size
        device = next(model.parameters()).device
        self._model = model
        self._input = torch.zeros((1, info.config.channels, height, width), device=device)
        self._input = self._input.contiguous(memory_format=torch.channels_last)
        self._graph: torch.cuda.CUDAGraph | None = None
        try:
            self._capture(device)
        except RuntimeError as error:
            torch.cuda.synchronize(device)
            print(f"warning: the network cannot be captured as a CUDA graph ({error}); it runs without")

    @torch.inference_mode()
    def _capture(self, device: torch.device) -> None:
        stream = torch.cuda.Stream(device)
        stream.wait_stream(torch.cuda.current_stream(device))
        with torch.cuda.stream(stream):  # libraries choose their kernels before the recording
            for _ in range(_WARM_UP):
                self._model(self._input)
        torch.cuda.current_stream(device).wait_stream(stream)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self._output = self._model(self._input)
        self._graph = graph

    def __call__(self, x: Tensor) -> Tensor:
        """Logits of one input (1, channels, H, W) on the network's device."""
        if self._graph is None or x.shape != self._input.shape:
            return self._model(x)
        self._input.copy_(x)
        self._graph.replay()
        return self._output
