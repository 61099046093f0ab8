#!/usr/bin/env bash
# Package: vtk 9.7.2 (PyVista, ParaView).
# Wrong belief: coordinates that a PLY file declares as double are read, and float64 points are written, with their digits.
# Behaviour: VTK reads and writes coordinates of PLY files as float32, whatever header and points say. Its readers of OBJ and legacy VTK
#   files keep float64.
# Why it matters: in UTM coordinates float32 has steps of 0.5 m: a surveyed mesh or cloud is torn by reading it, or by saving it again.
# Seen 2026-11-30: y of two points 0.222 m apart, 5412345.678 and 5412345.9: 0.5 m apart when read, and the written header says float.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 vtk==9.7.2

venv/bin/python - <<'PYTHON'
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

POINTS = np.array([(512345.678, 5412345.678, 312.5), (512346.1, 5412345.9, 312.6)])
rows = "\n".join(" ".join(map(repr, row)) for row in POINTS.tolist())
doubles = "property double x\nproperty double y\nproperty double z\n"
with open("read.ply", "w") as file:
    file.write(f"ply\nformat ascii 1.0\nelement vertex 2\n{doubles}end_header\n{rows}\n")
with open("read.obj", "w") as file:
    file.write("v " + rows.replace("\n", "\nv ") + "\n")

distances = {}
for reader, name in ((vtk.vtkPLYReader(), "read.ply"), (vtk.vtkOBJReader(), "read.obj")):
    reader.SetFileName(name)
    reader.Update()
    points = vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
    distances[name] = round(float(points[1, 1]) - float(points[0, 1]), 3)

points = vtk.vtkPoints()
points.SetData(numpy_to_vtk(POINTS))
data = vtk.vtkPolyData()
data.SetPoints(points)
writer = vtk.vtkPLYWriter()
writer.SetFileName("written.ply")
writer.SetFileTypeToASCII()
writer.SetInputData(data)
writer.Write()
with open("written.ply") as file:
    declared = [line.split()[1] for line in file if line.startswith("property") and "list" not in line]

print(distances, declared)
assert distances == {"read.ply": 0.5, "read.obj": 0.222}
assert declared == ["float", "float", "float"]
PYTHON
