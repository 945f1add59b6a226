# Draws a model with its shader and sheets, which lie in the project beside view.json, to picture.png.
extends SceneTree

# GLTFDocument: coordinates are not rounded to 16 bits.
const FORCE_DISABLE_MESH_COMPRESSION = 64

func _initialize():
    var about = JSON.parse_string(FileAccess.get_file_as_string("res://view.json"))
    var document = GLTFDocument.new()
    var state = GLTFState.new()
    document.append_from_file("res://model.gltf", state, FORCE_DISABLE_MESH_COMPRESSION)
    var model = document.generate_scene(state)
    var material = ShaderMaterial.new()
    material.shader = load("res://model.gdshader")
    for uniform in about.sheets:
        var image = Image.load_from_file("res://model-fans-%s.png" % about.sheets[uniform])
        material.set_shader_parameter(uniform, ImageTexture.create_from_image(image))
    for mesh in model.find_children("*", "MeshInstance3D", true, false):
        for surface in mesh.mesh.get_surface_count():
            mesh.set_surface_override_material(surface, material)
    var view = SubViewport.new()
    view.size = Vector2i(about.size[0], about.size[1])
    view.own_world_3d = true
    view.render_target_update_mode = SubViewport.UPDATE_ALWAYS
    view.add_child(model)
    var camera = Camera3D.new()
    view.add_child(camera)
    root.add_child(view)
    var place = func(p): return Vector3(p[0], p[1], p[2])
    camera.look_at_from_position(place.call(about.eye), place.call(about.target))
    camera.fov = about.fov
    camera.near = 0.01
    camera.current = true
    for frame in 4:
        await process_frame
    await RenderingServer.frame_post_draw
    view.get_texture().get_image().save_png("res://picture.png")
    quit()
