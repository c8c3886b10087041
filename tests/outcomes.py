"""Fuzz tests see both outcomes: a reader that refuses everything, or nothing, would pass otherwise."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def both_outcomes(error: type[Exception], *words: str) -> Iterator[Callable[..., Any]]:
    """Yield a function that reads or is refused, with one of the words in the error; both must have occurred."""
    seen: Counter[str] = Counter()

    def attempt(read: Callable[..., Any], *arguments: Any) -> Any:
        try:
            value = read(*arguments)
        except error as refusal:
            assert any(word in str(refusal) for word in words), refusal
            seen["refused"] += 1
            return None
        seen["read"] += 1
        return value

    yield attempt
    assert seen["read"] and seen["refused"], dict(seen)
