"""Robot files without meshes, with the same bodies, joints, actuators and inertias."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco

SHAPES = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)
"""Types of geoms that need a file."""


def stripped(file: Path) -> str:
    """Remove meshes, height fields, skins, textures and materials from MJCF; inertias are kept.

    Raises:
        ValueError: The file, before or after, does not compile; MuJoCo's message.
    """
    spec: Any = mujoco.MjSpec.from_file(str(file))
    whole = spec.compile()  # bodies have numbers only after compilation
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
    for item in (*spec.geoms, *spec.sites, *spec.tendons):
        item.material = ""
    for kind in ("skins", "meshes", "hfields", "materials", "textures", "flexes"):
        for item in list(getattr(spec, kind)):
            spec.delete(item)
    spec.compile()
    # Default classes also refer to files, and the specification does not list all of them.
    root = ElementTree.fromstring(spec.to_xml())
    for element in root.iter():
        for name in ("material", "mesh", "hfield"):
            element.attrib.pop(name, None)
        if element.tag == "geom" and element.get("type") in ("mesh", "hfield", "sdf"):
            del element.attrib["type"]
    xml = ElementTree.tostring(root, encoding="unicode")
    mujoco.MjModel.from_xml_string(xml)
    return xml
