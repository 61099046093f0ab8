"""Let other packages write the scene of two boxes again, into the folder of tests that reads it.

    python -m tools.exporters [PACKAGE …]

uv and npm install the packages in throw-away environments; bpy and Open3D take 1 GB. Open3D needs the system's
libusb-1.0, pyvista OpenGL. What each file is, and what is wrong with it, says exporters.toml in that folder.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent
FIXTURES: Final = Path("tests/files/exporters")
PACKAGES: Final = {
    "bpy": "bpy==5.0.1",
    "cadquery": "cadquery==2.7.0",
    "dracopy": "DracoPy==2.2.0 numpy==2.4.6",
    "open3d": "open3d==0.20.0",
    "pymeshlab": "pymeshlab==2025.7.post1 numpy==2.4.6",
    "pyvista": "pyvista==0.49.1 vtk==9.7.2",
    "trimesh": "trimesh==5.2.0 pycollada==0.9.3 pillow==13.0.0",
    "node": (
        "three@0.187.0 @gltf-transform/core@4.5.1 @gltf-transform/extensions@4.5.1 @gltf-transform/functions@4.5.1 "
        "draco3dgltf@1.5.7 meshoptimizer@1.3.0 gltfpack@1.3.0"
    ),
}
"""Packages by the name of a function in ``programs.py``, or ``node`` for ``programs.mjs``."""


def main() -> None:
    failed = []
    for name in sys.argv[1:] or PACKAGES:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            try:
                write(name, folder)
            except subprocess.CalledProcessError:  # its reason is on stderr
                failed.append(name)
                continue
            for file in sorted((folder / "out").iterdir()):
                print(f"{file.name}: {file.stat().st_size} bytes")
                shutil.copy(file, FIXTURES)
    if failed:
        sys.exit(f"not written: {', '.join(failed)}")


def write(name: str, folder: Path) -> None:
    """Install a package and let it write its files into ``out`` of a folder."""
    (folder / "out").mkdir()
    packages = PACKAGES[name].split()
    if name == "node":
        shutil.copy(HERE / "programs.mjs", folder)
        subprocess.run(["npm", "install", "--silent", *packages], cwd=folder, check=True)
        command = ["node", "programs.mjs", str(HERE / "boxes.json"), "out"]
    else:
        uv = Path(sys.executable).with_name("uv")
        options = [option for package in packages for option in ("--with", package)]
        command = [str(uv), "run", "--quiet", "--no-project", "--python", "3.11", *options, "python"]
        command += [str(HERE / "programs.py"), name, "out"]
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main()
