"""Write the software bill of materials of a release, CycloneDX JSON: `python checks/sbom.py FILE`.

Its components are those of `requirements.lock`, with the digests of their files. The same lock gives the same
bytes, apart from the serial number and the time.
"""

from __future__ import annotations

import re
import sys
from importlib.metadata import version
from pathlib import Path

from cyclonedx.model import HashAlgorithm, HashType
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output import make_outputter
from cyclonedx.schema import OutputFormat, SchemaVersion
from lock import ENTRY, LOCK
from packageurl import PackageURL

DIGEST = re.compile(r"sha256:([0-9a-f]{64})")


def component(name: str, number: str, digests: list[str], kind: ComponentType) -> Component:
    """Describe one distribution."""
    purl = PackageURL("pypi", name=name, version=number)
    hashes = [HashType(alg=HashAlgorithm.SHA_256, content=digest) for digest in digests]
    return Component(name=name, version=number, type=kind, purl=purl, bom_ref=purl.to_string(), hashes=hashes)


def bill_of_materials() -> Bom:
    """Collect unshade and all that it is installed with."""
    own = component("unshade", version("unshade"), [], ComponentType.APPLICATION)
    parts = [
        component(entry["name"], entry["version"], DIGEST.findall(entry[0]), ComponentType.LIBRARY)
        for entry in ENTRY.finditer(LOCK.read_text(encoding="utf-8"))
    ]
    bom = Bom(components=parts)
    bom.metadata.component = own
    bom.register_dependency(own, parts)
    return bom


def main(target: Path) -> None:
    """Write the file."""
    outputter = make_outputter(bill_of_materials(), OutputFormat.JSON, SchemaVersion.V1_6)
    target.write_text(outputter.output_as_string(indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
