"""XML of strangers: bounded in size, and no document type or entity is ever expanded."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from mam_pipeline.errors import InputError
from mam_pipeline.thresholds import MAX_XML_BYTES


class Doctype(InputError):
    """The document declares a type or an entity."""


def parse_xml(path: Path, most: int = MAX_XML_BYTES) -> ET.Element:
    """The root element of an XML file.

    Args:
        path: the file. most: bytes that it may have.

    Raises:
        Doctype: it declares a document type or an entity.
        InputError: too large, or not well-formed.
    """
    size = path.stat().st_size
    if size > most:
        raise InputError(f"{path} has {size >> 20} MiB of XML; the most is {most >> 20} MiB")
    data = path.read_bytes()
    parser = expat.ParserCreate()

    def refuse(*_: object) -> None:
        raise Doctype(f"{path}: a DOCTYPE or entity is declared; remove it")

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return ET.fromstring(data)
    except (expat.ExpatError, ET.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path} is not well-formed XML: {error}") from error
