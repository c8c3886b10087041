"""Fuzz tests see both outcomes: a reader that refuses everything, or nothing, would pass otherwise."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any


@contextmanager
def both_outcomes(error: type[Exception], word: str) -> Iterator[Callable[..., Any]]:
    """Yield a function that reads or is refused, with the word in the error; both must have occurred at the end."""
    seen: Counter[str] = Counter()

    def attempt(read: Callable[..., Any], *arguments: Any) -> Any:
        try:
            value = read(*arguments)
        except error as refusal:
            assert word in str(refusal)
            seen["refused"] += 1
            return None
        seen["read"] += 1
        return value

    yield attempt
    assert seen["read"] and seen["refused"], dict(seen)


_SEEN: Counter[str] = Counter()


@contextmanager
def outcome(error: type[Exception]) -> Iterator[None]:
    """Count whether what follows is read or refused with an error of ours."""
    try:
        yield
    except error:
        _SEEN["refused"] += 1
    else:
        _SEEN["read"] += 1


def sees_both_outcomes(test: Callable[..., None]) -> Callable[..., None]:
    """Return a test that fails unless both outcomes occurred among its examples."""

    @wraps(test)
    def run(*arguments: Any, **keywords: Any) -> None:
        _SEEN.clear()
        test(*arguments, **keywords)
        assert _SEEN["read"] and _SEEN["refused"], dict(_SEEN)

    return run
