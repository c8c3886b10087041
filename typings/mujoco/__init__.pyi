# MuJoCo's compiled modules carry no types: everything of it is Any to pyright.
from typing import Any

def __getattr__(name: str) -> Any: ...
