"""Parallel calls of a function: in processes on all cores, or on a cluster."""

import signal
import sys
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, TypeVar

from coheft.errors import CoheftError, MissingPackageError
from coheft.wire.process.memory import reuse_memory

T = TypeVar("T")

_TRACKER = "ignore:resource_tracker"
"""Joblib's process that removes what an interrupted command left would list it among the command's own words."""


def usual_jobs() -> int:
    """Return the number of cores available to this process; one if joblib is not installed."""
    if find_spec("joblib") is None:
        return 1
    import joblib

    return int(joblib.cpu_count())


@contextmanager
def workers(jobs: int | None = None, dask: str | None = None) -> Iterator[None]:
    """Configure where ``side_by_side`` makes its calls, while the context lasts.

    That is in a number of processes, by default one per core, or at the workers of the Dask scheduler at an address.
    A ``CoheftError`` says that there is no such scheduler, or that a worker was killed.
    """
    try:
        import joblib
    except ImportError as error:
        raise MissingPackageError("joblib", "study") from error
    if dask is None:
        # Threads only slow down linear algebra with small matrices.
        settings = {"inner_max_num_threads": 1, "initializer": _begin_worker}
        sys.warnoptions.append(_TRACKER)  # new processes of Python begin with these options
        try:
            with joblib.parallel_config("loky", n_jobs=jobs or usual_jobs(), **settings):
                yield
        except BrokenProcessPool as error:
            raise CoheftError(
                "a process that did part of the work was killed, possibly because memory ran out: "
                "use fewer processes, with --jobs"
            ) from error
        finally:
            sys.warnoptions.remove(_TRACKER)
        return
    try:
        from distributed import Client

        client = Client(dask)
    except ImportError as error:
        raise MissingPackageError("distributed", "dask") from error
    except (OSError, ValueError) as error:
        raise CoheftError(f"no Dask scheduler answers at {dask}: {error}") from error
    with client, joblib.parallel_config("dask", n_jobs=-1):
        yield


def _begin_worker() -> None:
    """Ignore Ctrl-C, which a terminal sends to workers as well: the command ends them, without tracebacks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    reuse_memory()


def side_by_side(function: Callable[..., T], arguments: Iterable[tuple[Any, ...]]) -> Iterator[T]:
    """Call a function with each of many tuples of arguments; yield results as they arrive, while ``workers`` last."""
    import joblib

    parallel = joblib.Parallel(return_as="generator_unordered")
    results: Generator[T, None, None] = parallel(joblib.delayed(function)(*each) for each in arguments)
    try:
        for result in results:  # noqa: UP028  "yield from" would close them before warnings are filtered
            yield result
    finally:
        with warnings.catch_warnings():  # that an interrupted command leaves results unused
            warnings.simplefilter("ignore")
            results.close()
