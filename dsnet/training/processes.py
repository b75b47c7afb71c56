"""Training on several processes (torchrun): each takes its share of every batch, rank 0 alone writes."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.distributed.nn.functional import all_reduce
from torch.nn.parallel import DistributedDataParallel

from dsmap.errors import InputError

_PATIENCE = timedelta(hours=12)
"""Rank 0 validates while the others wait."""


@dataclass(frozen=True)
class Ranks:
    """Which of how many processes this one is."""

    rank: int = 0
    world: int = 1
    device: str = "cpu"

    @property
    def first(self) -> bool:
        """Whether this is the process that writes."""
        return self.rank == 0

    def samples(self, first_step: int, steps: int, batch: int) -> range:
        """This rank's samples of the stream: batch s holds samples s * batch .. (s + 1) * batch - 1 over all ranks.

        Raises:
            InputError: the ranks cannot share a batch evenly.
        """
        if batch % self.world:
            raise InputError(f"training: batch is {batch}, expected a multiple of the {self.world} processes")
        return range(first_step * batch + self.rank, steps * batch, self.world)

    def parallel(self, model: nn.Module) -> nn.Module:
        """The model whose gradients are the means over all ranks; itself for one."""
        if self.world == 1:
            return model
        ids = None if self.device == "cpu" else [torch.device(self.device).index]
        return DistributedDataParallel(model, device_ids=ids, broadcast_buffers=False)

    def synchronised(self, model: nn.Module) -> nn.Module:
        """The same parameters with batch norms over the batch of all ranks (PyTorch's is for CUDA only)."""
        if self.world == 1:
            return model
        if self.device != "cpu":
            return nn.SyncBatchNorm.convert_sync_batchnorm(model)
        for module in model.modules():
            if type(module) is nn.BatchNorm2d:
                module.__class__ = _BatchNormOverRanks
        return model

    def total(self, value: Tensor) -> Tensor:
        """The sum over all ranks, without a gradient."""
        if self.world > 1:
            value = value.detach().clone()
            dist.all_reduce(value)
        return value

    def of_first(self, value: Any) -> Any:
        """What rank 0 has, on all ranks, which meet here."""
        if self.world == 1:
            return value
        box = [value]
        dist.broadcast_object_list(box, src=0)
        return box[0]


class _BatchNormOverRanks(nn.BatchNorm2d):
    """Batch norm over the batches of all ranks, which must be of one size; mean first, then variance."""

    def forward(self, input: Tensor) -> Tensor:
        if not self.training:
            return super().forward(input)
        values, world = input.float(), dist.get_world_size()
        mean = all_reduce(values.mean(dim=(0, 2, 3))) / world
        centred = values - mean[:, None, None]
        variance = all_reduce(centred.square().mean(dim=(0, 2, 3))) / world
        count = world * input.numel() / input.shape[1]
        with torch.no_grad():
            momentum = 0.1 if self.momentum is None else self.momentum
            if self.running_mean is not None and self.running_var is not None:
                self.running_mean.lerp_(mean, momentum)
                self.running_var.lerp_(variance * (count / max(count - 1, 1)), momentum)
            if self.num_batches_tracked is not None:
                self.num_batches_tracked.add_(1)
        scale = self.weight * torch.rsqrt(variance + self.eps)
        return (centred * scale[:, None, None] + self.bias[:, None, None]).to(input.dtype)


@contextlib.contextmanager
def joined(device: str) -> Iterator[Ranks]:
    """Join the processes that torchrun started; one of one without torchrun. May be nested.

    Args:
        device: cpu (gloo) or cuda (nccl; every process takes the GPU of its local rank).
    """
    world = int(os.environ.get("WORLD_SIZE", "1"))
    if world == 1:
        yield Ranks(device=device)
        return
    if device == "cuda":
        device = f"cuda:{os.environ.get('LOCAL_RANK', '0')}"
        torch.cuda.set_device(device)
    ours = not dist.is_initialized()
    if ours:
        dist.init_process_group("gloo" if device == "cpu" else "nccl", timeout=_PATIENCE)
    try:
        yield Ranks(dist.get_rank(), world, device)
    finally:
        if ours:
            dist.destroy_process_group()
