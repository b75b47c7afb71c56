"""Many scenes: planned from one seed, rendered by many processes (or a Ray cluster), resumable, with a card.

Each scene is a sequence in a folder of its own. A scene is rendered under a temporary name, one of its process, and
renamed when every file of it is there, and running the same command again goes on. Workers end with their parent.
"""

import json
import os
import re
import shutil
import signal
import socket
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context, parent_process
from pathlib import Path

import numpy as np

from dsmap.classes import NUM_CLASSES
from dsmap.errors import InputError, InputWarning, WriteError
from dsmap.files import as_read_back, write_json
from dsmap.sim_scenes.recording.record import RenderedFrame, RenderOptions, render_sequence
from dsmap.sim_scenes.recording.whole import SUMMARY, what_is_missing
from dsmap.sim_scenes.rooms.build import MIX

_TRIES = 3
"""A scene whose worker dies this many times ends the run."""
_PARTIAL = re.compile(r"\..+\.part")
"""Names of scenes that are being rendered."""


@dataclass(frozen=True)
class Task:
    """One scene of a data set."""

    folder: Path
    options: RenderOptions


def plan(out: Path, base: RenderOptions, count: int) -> list[Task]:
    """The scenes of a data set: seeds base.seed, base.seed + 1, ...; scene `mix` draws each one's kind.

    The kinds of a mix follow from the seed alone, so a longer data set begins like a shorter one.

    Raises:
        InputError: count is not positive, or the options are out of range.
    """
    if count < 1:
        raise InputError(f"count is {count}; expected at least 1")
    tasks = []
    for seed in range(base.seed, base.seed + count):
        options = replace(base, scene=kind_of(seed) if base.scene == "mix" else base.scene, seed=seed)
        options.check()
        tasks.append(Task(out / f"{Path(options.scene).stem}_{seed:06d}", options))
    return tasks


def kind_of(seed: int) -> str:
    """The kind of room that the mix gives a seed."""
    kinds, shares = list(MIX), np.array(list(MIX.values()), float)
    return kinds[int(np.random.default_rng([seed, 4242]).choice(len(kinds), p=shares / shares.sum()))]


def unfinished(tasks: Iterable[Task]) -> list[Task]:
    """The tasks that are still to be done; a scene that is not whole (a full disk, a power cut) is one of them.

    Raises:
        InputError: a finished scene was rendered with other options, so the folder would hold a mixture.
    """
    left = []
    for task in tasks:
        if not task.folder.exists():
            left.append(task)
            continue
        file = task.folder / "scene.json"
        try:
            found = json.loads(file.read_text())["options"]
        except (OSError, ValueError, KeyError) as error:
            raise InputError(
                f"{file}: not readable ({error}); expected a scene that dsmap rendered"
            ) from error
        wanted = as_read_back(_lasting(task.options))
        differ = sorted(k for k in wanted if found.get(k) != wanted[k])
        if differ:
            name = differ[0]
            raise InputError(
                f"{file}: {name} is {found.get(name)!r}, expected {wanted[name]!r} as asked for now; "
                "a data set holds one kind of recording, so choose a new folder"
            )
        if missing := what_is_missing(task.folder):
            text = f"{task.folder} is not whole ({missing}): it is rendered again"
            warnings.warn(text, InputWarning, stacklevel=2)
            left.append(task)
    return left


def _lasting(options: RenderOptions) -> dict:
    """The options that decide what is rendered."""
    return {k: v for k, v in asdict(options).items() if k != "jobs"}


def render_task(task: Task) -> Path:
    """Render one scene of a data set; a crash leaves nothing under its final name."""
    pixels, frames = np.zeros(NUM_CLASSES, np.int64), 0

    def count(rendered: Iterable[RenderedFrame], _: int) -> Iterator[RenderedFrame]:
        nonlocal frames
        for frame in rendered:
            pixels[:] += np.bincount(frame.label.ravel(), minlength=NUM_CLASSES)[:NUM_CLASSES]
            frames += 1
            yield frame

    partial = task.folder.with_name(f".{task.folder.name}.{os.getpid()}.part")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        render_sequence(partial, task.options, progress=count)
        write_json(partial / SUMMARY, {"frames": frames, "pixels": pixels.tolist()}, indent=None)
        if missing := what_is_missing(partial):
            raise WriteError(f"cannot write {task.folder}: {missing}", (task.folder.name,), missing)
        shutil.rmtree(task.folder, ignore_errors=True)  # one that was not whole
        os.replace(partial, task.folder)
    except OSError as error:
        raise WriteError(f"cannot write {task.folder}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return task.folder


def remove_partials(out: Path) -> None:
    """Delete scenes that killed processes were rendering; call it while the data set is `locked`."""
    for folder in sorted(out.iterdir()):
        if _PARTIAL.fullmatch(folder.name) and folder.is_dir() and not folder.is_symlink():
            shutil.rmtree(folder, ignore_errors=True)


def run_local(tasks: list[Task], jobs: int, done: Callable[[Path], object]) -> None:
    """Render tasks in `jobs` processes, one scene each at a time.

    A worker that dies (out of memory, killed) costs its scene a try, not the run.

    Raises:
        InputError: a scene cannot be rendered, or its worker died three times.
    """
    waiting = list(tasks)
    for _ in range(_TRIES):
        with worker_pool(jobs) as pool:
            futures = {pool.submit(render_task, task): task for task in waiting}
            try:
                for future in as_completed(futures):
                    done(future.result())
                    waiting.remove(futures[future])
            except BrokenProcessPool:
                continue
            except BaseException:
                workers = list((pool._processes or {}).values())
                pool.shutdown(wait=False, cancel_futures=True)
                for worker in workers:  # their scenes would take minutes that nobody waits for
                    worker.terminate()
                raise
        return
    raise InputError(
        f"{waiting[0].folder}: its worker process died {_TRIES} times; is there memory for this many jobs?"
    )


def worker_pool(jobs: int) -> ProcessPoolExecutor:
    """Processes that render, one thread each. Warp and OpenGL do not survive a fork: each worker starts afresh."""
    return ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin_worker)


def _begin_worker() -> None:
    _one_thread()
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches the whole group: the parent ends its workers
    threading.Thread(target=_end_with_parent, name="dsmap-parent", daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed cannot end its workers: they would go on, half a gigabyte each, and for nothing."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _one_thread() -> None:
    os.environ["OMP_NUM_THREADS"] = "1"
    import cv2

    cv2.setNumThreads(1)


def run_ray(tasks: list[Task], address: str, done: Callable[[Path], object]) -> None:
    """Render tasks on a Ray cluster (`local` starts one here), one core a scene; needs the extra `ray`.

    The output folder must be one that all nodes share. Ray runs a task again whose worker or node died.

    Raises:
        InputError: the cluster cannot be reached, or a scene cannot be rendered.
    """
    import ray

    _check_reachable(address)
    try:
        ray.init(address=None if address == "local" else address, log_to_driver=False)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InputError(
            f"--ray {address}: no cluster there ({str(error).splitlines()[0]}); expected `local`, `auto` or host:port"
        ) from error
    try:
        remote = ray.remote(num_cpus=1, max_retries=_TRIES)(_ray_task)
        waiting = [remote.remote(Task(task.folder.resolve(), task.options)) for task in tasks]
        while waiting:
            finished, waiting = ray.wait(waiting)
            for folder in ray.get(finished):
                done(folder)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from error
    finally:
        ray.shutdown()


def _check_reachable(address: str) -> None:
    """Ray itself waits for minutes where nobody answers."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host:
        return  # `local`, `auto`
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except (OSError, ValueError) as error:
        raise InputError(
            f"--ray {address}: nobody answers there ({error}); expected `local`, `auto` or host:port"
        ) from error


def _ray_task(task: Task) -> Path:
    _one_thread()
    return render_task(task)
