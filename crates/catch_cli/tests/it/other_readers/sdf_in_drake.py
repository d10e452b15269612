"""Prints the numbers that Drake reads of SDF files, which stand in JSON on standard input, as `numbers` of
`sdf.rs` has them; `null` where Drake reads nothing."""

import json
import pathlib
import sys
import tempfile

import numpy
import pydrake.geometry
import pydrake.multibody.parsing
import pydrake.multibody.plant
import pydrake.multibody.tree
import pydrake.systems.framework

POINT = numpy.array([0.1, 0.2, 0.3])
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def size(shape):
    """Three numbers for a shape."""
    match type(shape).__name__:
        case "Box":
            return shape.size()
        case "Cylinder" | "Capsule":
            return [shape.radius(), shape.length(), 0]
        case "Sphere":
            return [shape.radius(), 0, 0]
        case "Ellipsoid":
            return [shape.a(), shape.b(), shape.c()]
        case "Mesh" | "Convex":
            return shape.scale3()


def read(text, folder):
    """Sums over links and shapes, each weighted by its number."""
    builder = pydrake.systems.framework.DiagramBuilder()
    plant, scene_graph = pydrake.multibody.plant.AddMultibodyPlantSceneGraph(builder, 0.0)
    parser = pydrake.multibody.parsing.Parser(plant)
    parser.package_map().Add("p", folder)
    try:
        parser.AddModelsFromString(text, "sdf")
    except RuntimeError as fault:
        print(fault, file=sys.stderr)
        return None
    inspector = scene_graph.model_inspector()
    of_mass, friction, shapes = numpy.zeros(10), 0.0, numpy.zeros((2, 6))
    for i in range(1, plant.num_bodies()):
        body = plant.get_body(pydrake.multibody.tree.BodyIndex(i))
        weight = int(body.name()[1:]) + 1
        mass, com = body.default_mass(), body.default_com()
        about_com = body.default_rotational_inertia().CopyToFullMatrix3()
        about_com = about_com - mass * (com @ com * numpy.eye(3) - numpy.outer(com, com))
        of_mass += weight * numpy.array([mass, *com, *about_com[numpy.triu_indices(3)]])
        collisions = plant.GetCollisionGeometriesForBody(body)
        for sums, geometries in zip(shapes, [plant.GetVisualGeometriesForBody(body), collisions]):
            for it in geometries:
                if type(inspector.GetShape(it)).__name__ == "HalfSpace":
                    continue
                number = int(inspector.GetName(it).rsplit("::")[-1][1:]) + 1
                point = inspector.GetPoseInFrame(it) @ POINT
                sums += weight * number * numpy.array([*point, *size(inspector.GetShape(it))])
        found = [inspector.GetProximityProperties(it).GetProperty("material", "coulomb_friction") for it in collisions]
        friction += weight * min([it.static_friction() for it in found] + [1.0])
    return [round(float(it), 6) for it in [*of_mass, friction, *shapes.flatten()]]


with tempfile.TemporaryDirectory() as folder:
    pathlib.Path(folder, "a.obj").write_text(MESH)
    print("[" + ",\n".join(json.dumps(text and read(text, folder)) for text in json.load(sys.stdin)) + "]")
