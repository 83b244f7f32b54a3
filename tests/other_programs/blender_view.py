"""What Blender makes of a model: ``blender_view.py MODEL VIEW PASSES.exr``; needs Blender's module, `bpy`.

VIEW is JSON: `world_from_camera` (4×4; x right, y up, looks along −z, in axes whose z is up), `fov_deg` of
the square picture, `side` in px, and `sun`, its rotation about x, y, z, radians. PASSES has the picture under
that sun and Cycles' pass of the diffuse colour, linear. Prints facts of what was imported, as JSON.
"""

import json
import os
import sys
from math import radians
from pathlib import Path

import bpy

SAMPLES = 32  # of a pixel


def imported(model: Path) -> dict[str, object]:
    """Import the model alone; tell what came."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(model))
    meshes = [one for one in bpy.context.scene.objects if one.type == "MESH"]
    images = {
        node.image.name: [node.image.colorspace_settings.name, *node.image.size]
        for one in meshes
        for slot in one.material_slots
        for node in slot.material.node_tree.nodes
        if node.type == "TEX_IMAGE"
    }
    corners = [one.matrix_world @ vertex.co for one in meshes for vertex in one.data.vertices]
    return {
        "objects": len(meshes),
        "triangles": sum(len(one.data.polygons) for one in meshes),
        "low": [min(corner[axis] for corner in corners) for axis in range(3)],
        "high": [max(corner[axis] for corner in corners) for axis in range(3)],
        "images": images,
    }


def render(view: dict, passes: Path) -> None:
    """Render with Cycles on the processor, without the filmic curve of the screen."""
    scene = bpy.context.scene
    camera = bpy.data.cameras.new("camera")
    camera.angle = radians(view["fov_deg"])
    camera.clip_start, camera.clip_end = 1e-4, 1e6
    placed = bpy.data.objects.new("camera", camera)
    placed.matrix_world = list(zip(*view["world_from_camera"], strict=True))
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy = 3.0
    lamp = bpy.data.objects.new("sun", sun)
    lamp.rotation_euler = view["sun"]
    scene.world = bpy.data.worlds.new("world")
    for one in (placed, lamp):
        scene.collection.objects.link(one)
    scene.camera = placed
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", SAMPLES
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = view["side"]
    scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.image_settings.color_depth = "32"
    bpy.context.view_layer.use_pass_diffuse_color = True
    scene.render.filepath = str(passes)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    model, view, passes = map(Path, sys.argv[1:])
    facts = imported(model)
    render(json.loads(view.read_text(encoding="utf-8")), passes)
    print("\n" + json.dumps(facts), flush=True)
    os._exit(0)  # the module may crash while Python takes itself down
