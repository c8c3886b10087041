"""XML of other programs: data, in which nothing stands for anything else."""

import re
from xml.etree import ElementTree as ET


def parse_xml(content: bytes) -> ET.Element:
    """Return the outermost element of a file.

    Raises:
        ValueError: It is no XML, or declares entities, which can stand for any file and any amount of text.
    """
    if b"<!ENTITY" in content or b"<!DOCTYPE" in content or b"\0" in content:
        raise ValueError("it declares entities, which are not needed, or is no text. Take the declaration out.")
    try:
        return ET.fromstring(re.sub(rb"^\s*<\?xml[^>]*\?>", b"", content))
    except (ET.ParseError, ValueError, RecursionError) as error:
        raise ValueError(f"it is no XML ({error}).") from error
