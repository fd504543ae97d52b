"""Files that a model names and that are not there: shapes and looks are left out as long as every mass is given."""

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING

from plants.mujoco_robot.loading.packages import SCHEMES, places_of
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    import mujoco

READABLE = (".stl", ".obj", ".msh")  # meshes that MuJoCo reads


def leave_out_absent(spec: "mujoco.MjSpec", path: str) -> str | None:
    """Take meshes, height fields, textures and skins without a file out of a specification, and the shapes that they
    make up; meshes of a ROS package are looked for as `places_of` says. What was left out, None for nothing.

    Raises BadInput where a body takes its mass from such a shape.
    """
    meshes = [m for m in spec.meshes if m.file and _place(m, spec.meshdir, spec, path) is None]
    fields = [h for h in spec.hfields if h.file and _place(h, spec.meshdir, spec, path) is None]
    skins = [s for s in spec.skins if s.file and _place(s, spec.meshdir, spec, path) is None]
    textures = [t for t in spec.textures if _unpainted(t, spec, path)]
    shapes = [g for g in spec.geoms if _made_of(g, meshes, fields)]
    for shape in shapes:
        _refuse_massive(shape, spec, meshes, path)
    gone = {g.name for g in shapes} - {""}
    for pair in [p for p in spec.pairs if {p.geomname1, p.geomname2} & gone]:
        spec.delete(pair)
    for sensor in [s for s in spec.sensors if {s.objname, s.refname} & gone and _about_geoms(s)]:
        spec.delete(sensor)
    unpainted = {t.name or Path(t.file).stem for t in textures}
    for material in spec.materials:
        if unpainted & set(material.textures):
            material.textures = ["" if name in unpainted else name for name in material.textures]
    names = sorted({name for x in (*meshes, *fields, *skins, *textures) for name in _files(x)})
    for absent in (*shapes, *meshes, *fields, *skins, *textures):
        spec.delete(absent)
    if not names:
        return None
    some = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    left_out = f"{len(shapes)} shape{'s' * (len(shapes) != 1)} removed and ignored in contacts"
    which = "1 of its files is missing" if len(names) == 1 else f"{len(names)} of its files are missing"
    return f"{which} ({some}): {left_out}"


def _place(asset: "mujoco.MjsMesh", folder: str, spec: "mujoco.MjSpec", path: str) -> Path | None:
    """Where an asset's file lies, None where it is not or is of no kind that MuJoCo reads; a file of a package that is
    found is entered into the asset."""
    import mujoco

    name, home = asset.file, Path(path).parent
    if isinstance(asset, mujoco.MjsMesh) and not asset.content_type and Path(name).suffix.lower() not in READABLE:
        return None
    if not name.startswith(SCHEMES):
        own = home / folder / (Path(name).name if spec.strippath else name)
        return own if own.is_file() else None
    found = next((p for p in places_of(name, home.resolve()) if p.is_file()), None)
    if found is not None:
        asset.file = str(found)
    return found


def _files(asset: "mujoco.MjsMesh") -> list[str]:
    several = list(getattr(asset, "cubefiles", ()))
    return [Path(f).name for f in (asset.file, *several) if f]


def _unpainted(texture: "mujoco.MjsTexture", spec: "mujoco.MjSpec", path: str) -> bool:
    home = Path(path).parent / spec.texturedir
    files = [f for f in (texture.file, *texture.cubefiles) if f]
    return not all((home / (Path(f).name if spec.strippath else f)).is_file() for f in files)


def _made_of(geom: "mujoco.MjsGeom", meshes: list, fields: list) -> bool:  # type: ignore[type-arg]
    absent = {m.name or Path(m.file).stem for m in meshes}, {h.name or Path(h.file).stem for h in fields}
    return geom.meshname in absent[0] - {""} or geom.hfieldname in absent[1] - {""}


def _about_geoms(sensor: "mujoco.MjsSensor") -> bool:
    import mujoco

    return mujoco.mjtObj.mjOBJ_GEOM in (sensor.objtype, sensor.reftype)


def _refuse_massive(geom: "mujoco.MjsGeom", spec: "mujoco.MjSpec", meshes: list, path: str) -> None:  # type: ignore[type-arg]
    import mujoco

    body, compiler = geom.parent, spec.compiler
    massless = geom.density == 0 if isnan(geom.mass) else geom.mass == 0
    low, high = compiler.inertiagrouprange
    always = compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    given = body.explicitinertial and not always
    if given or massless or not low <= geom.group <= high or not _moves(body, spec):
        return
    files = [Path(m.file).name for m in meshes if (m.name or Path(m.file).stem) == geom.meshname]
    raise BadInput(
        f"body {body.name!r} takes its mass from {', '.join(files) or geom.hfieldname}, which is missing",
        path,
        'put the file where the model expects it, or give the body an <inertial> and set inertiafromgeom to "auto"',
    )


def _moves(body: "mujoco.MjsBody", spec: "mujoco.MjSpec") -> bool:
    """Whether a joint moves the body: what is fixed to the world needs no mass."""
    while body is not None and body.name != spec.worldbody.name:
        if len(body.joints):
            return True
        body = body.parent
    return False
