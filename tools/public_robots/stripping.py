"""A robot's file without meshes: the same bodies, joints, actuators and inertias."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco

SHAPES = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)
"""Geoms that need a file."""


def stripped(file: Path) -> str:
    """MJCF without meshes, height fields, skins, textures and materials; bodies keep inertias.

    Raises:
        ValueError: The file, or what is left of it, does not compile; as MuJoCo says it.
    """
    spec: Any = mujoco.MjSpec.from_file(str(file))
    whole = spec.compile()  # before it is compiled bodies have no numbers
    for body in spec.bodies[1:]:
        k = body.id
        if whole.body_mass[k] > 0:
            body.explicitinertial, body.fullinertia = True, [float("nan")] * 6
            body.mass, body.inertia = whole.body_mass[k], whole.body_inertia[k]
            body.ipos, body.iquat = whole.body_ipos[k], whole.body_iquat[k]
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    spec.compiler.settotalmass = -1
    for geom in list(spec.geoms):
        if geom.type in SHAPES or geom.meshname or geom.hfieldname:
            spec.delete(geom)
    for each in (*spec.geoms, *spec.sites, *spec.tendons):
        each.material = ""
    for kind in ("skins", "meshes", "hfields", "materials", "textures", "flexes"):
        for each in list(getattr(spec, kind)):
            spec.delete(each)
    spec.compile()
    # Default classes refer to files, too, and the specification does not give all of them.
    root = ElementTree.fromstring(spec.to_xml())
    for element in root.iter():
        for name in ("material", "mesh", "hfield"):
            element.attrib.pop(name, None)
        if element.tag == "geom" and element.get("type") in ("mesh", "hfield", "sdf"):
            del element.attrib["type"]
    xml = ElementTree.tostring(root, encoding="unicode")
    mujoco.MjModel.from_xml_string(xml)
    return xml
