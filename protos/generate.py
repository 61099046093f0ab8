"""Writes image_interface_pb2.py and .pyi of ``scenegate.camera`` from image_interface.proto.

``make generate`` runs it with grpcio-tools. The results are committed, so that installing needs no compiler; a test
generates again and compares.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
TARGET = HERE.parent / "client" / "scenegate" / "camera"


def generate(folder: Path) -> None:
    """Runs protoc into ``folder``.

    Raises:
        RuntimeError: protoc refused the file (it says why on stderr).
    """
    from grpc_tools import protoc

    include = Path(protoc.__file__).parent / "_proto"
    arguments = ["protoc", f"-I{HERE}", f"-I{include}", f"--python_out={folder}", f"--pyi_out={folder}"]
    if protoc.main([*arguments, "image_interface.proto"]) != 0:
        raise RuntimeError("protoc failed on image_interface.proto")


if __name__ == "__main__":
    generate(Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET)
