"""Many calls side by side: in processes on all cores, or on a cluster."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from importlib.util import find_spec
from typing import Any, TypeVar

from coheft.errors import CoheftError, MissingPackageError

T = TypeVar("T")


def usual_jobs() -> int:
    """As many processes as there are cores that this one may use; one if the package for more is not installed."""
    if find_spec("joblib") is None:
        return 1
    import joblib

    return int(joblib.cpu_count())


@contextmanager
def workers(jobs: int | None = None, dask: str | None = None) -> Iterator[None]:
    """Where ``side_by_side`` makes its calls while the context lasts.

    Args:
        jobs: Number of processes; None for one per core.
        dask: Address of a Dask scheduler whose workers are used, instead of this machine's cores.

    Raises:
        MissingPackageError: A package for it is not installed.
        CoheftError: There is no such scheduler, or a worker was killed.
    """
    try:
        import joblib
    except ImportError as error:
        raise MissingPackageError("joblib", "study") from error
    if dask is None:
        # Linear algebra on small matrices only loses by threads of its own. Ctrl-C, which a terminal sends to workers
        # as well, is left to this process, which ends them: they would write tracebacks.
        deaf = {"initializer": signal.signal, "initargs": (signal.SIGINT, signal.SIG_IGN)}
        with joblib.parallel_config("loky", n_jobs=jobs or usual_jobs(), inner_max_num_threads=1, **deaf):
            try:
                yield
            except BrokenProcessPool as error:
                raise CoheftError(
                    "a process that did part of the work was killed, maybe because memory ran out: fewer processes "
                    "need less, say how many with --jobs"
                ) from error
        return
    with _client(dask), joblib.parallel_config("dask", n_jobs=-1):
        yield


def side_by_side(function: Callable[..., T], arguments: Iterable[tuple[Any, ...]]) -> Iterator[T]:
    """Call a function with each of many arguments, within ``workers``; results come as soon as they are there."""
    import joblib

    parallel = joblib.Parallel(return_as="generator_unordered")
    results: Iterator[T] = parallel(joblib.delayed(function)(*each) for each in arguments)
    return results


def _client(address: str) -> AbstractContextManager[object]:
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingPackageError("distributed", "dask") from error
    try:
        client: AbstractContextManager[object] = Client(address)
    except (OSError, ValueError) as error:
        raise CoheftError(f"no Dask scheduler answers at {address}: {error}") from error
    return client
