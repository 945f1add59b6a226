//! Cameras and the views of lamps.

mod camera {
    use fantex_base::Aabb;
    use fantex_mesh::{Mesh, WorldFromMesh};
    use fantex_scene::{Camera, Projection};
    use glam::{DVec2, DVec3, Vec3};

    fn box_mesh() -> Mesh {
        let bounds = Aabb { min: DVec3::splat(-0.5), max: DVec3::new(0.5, 0.25, 0.75) };
        Mesh {
            positions: bounds.corners().map(|c| c.as_vec3()).to_vec(),
            world_from_mesh: WorldFromMesh { offset: DVec3::new(1e4, 5.0, -7.0), scale: 16.0 },
            ..Mesh::default()
        }
    }

    #[test]
    fn framing_touches_the_picture_and_stays_inside() {
        let mesh = box_mesh();
        let size = [640, 360];
        for direction in
            [Camera::THREE_QUARTER, DVec3::Y, DVec3::NEG_Y, DVec3::X, DVec3::new(-1.0, -0.2, 0.1)]
        {
            let camera = Camera::framing_mesh(&mesh, direction, 640.0 / 360.0);
            let projection = Projection::new(&camera, size, &mesh);
            let screen: Vec<_> = mesh
                .positions
                .iter()
                .map(|&p| projection.project(p))
                .inspect(|h| assert!(h.z > projection.near))
                .map(|h| h.truncate() / h.z / DVec2::new(640.0, 360.0) - 0.5)
                .collect();
            let reach = screen.iter().fold(DVec2::ZERO, |r, s| r.max(s.abs()));
            assert!(reach.max_element() < 0.5 && reach.max_element() > 0.45, "{direction}: {reach}");
            let sum = |pick: fn(DVec2, DVec2) -> DVec2| screen.iter().copied().reduce(pick).unwrap();
            let margins = sum(DVec2::min) + sum(DVec2::max);
            assert!(margins.abs().max_element() < 0.01, "{direction}: {margins}");
        }
    }

    #[test]
    fn framing_suits_the_lens_and_what_is_up() {
        let mesh = box_mesh();
        for (fov, up) in [(35.0, DVec3::Z), (8.0, DVec3::Y), (100.0, DVec3::NEG_Y), (60.0, DVec3::ZERO)] {
            let camera = Camera::framing_mesh_with(&mesh, Camera::THREE_QUARTER, 1.5, up, fov);
            assert_eq!((camera.defect(), camera.fov_degrees), (None, fov));
            assert!(camera.up.dot(up) >= 0.0, "{}", camera.up);
            let projection = Projection::new(&camera, [300, 200], &mesh);
            let shown = mesh.positions.iter().map(|&p| projection.project(p));
            let shown = shown.map(|h| (h.truncate() / h.z / DVec2::new(300.0, 200.0) - 0.5).abs());
            let reach = shown.reduce(DVec2::max).unwrap().max_element();
            assert!(reach < 0.5 && reach > 0.45, "{fov} {up}: {reach}");
        }
        for fov in [0.0, 180.0, f64::NAN] {
            let camera = Camera::framing_mesh_with(&mesh, Camera::THREE_QUARTER, 1.5, DVec3::Y, fov);
            assert!(camera.defect().unwrap().contains("opening angle"), "{fov}");
        }
        let framed = Camera::framing_mesh_with(&mesh, Camera::THREE_QUARTER, 1.5, DVec3::Y, 35.0);
        assert_eq!(Camera { up: DVec3::ZERO, ..framed }.defect(), Some("its up vector is zero"));
    }

    #[test]
    fn framing_depends_on_neither_size_nor_place() {
        let places =
            [(0.0, 1e-12), (1e9, 1.0), (-1e9, 1e-3), (1e15, 1e3), (0.0, 1e20), (3.0, 1e-6), (1e7, 1e-6)];
        for (offset, scale) in places {
            let world_from_mesh = WorldFromMesh { offset: DVec3::splat(offset), scale };
            let mesh = Mesh { world_from_mesh, ..box_mesh() };
            let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.0);
            let projection = Projection::new(&camera, [100, 100], &mesh);
            let seen = mesh.positions.iter().map(|&p| projection.project(p)).map(|h| h.truncate() / h.z);
            let (low, high) =
                seen.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
            assert!((high - low).max_element() > 85.0, "{offset} {scale}: {low} {high}");
            assert!(low.min_element() > 0.0 && high.max_element() < 100.0, "{offset} {scale}: {low} {high}");
        }
    }

    #[test]
    fn up_is_up_and_right_is_right() {
        let mesh = box_mesh();
        let camera = Camera {
            eye: DVec3::new(1e4, 5.0, 93.0),
            target: mesh.world_from_mesh.offset,
            up: DVec3::Y,
            fov_degrees: 40.0,
        };
        let projection = Projection::new(&camera, [200, 100], &mesh);
        let at = |p| {
            let h = projection.project(p);
            h.truncate() / h.z
        };
        assert!((at(Vec3::ZERO) - DVec2::new(100.0, 50.0)).length() < 1e-6);
        assert!(at(Vec3::X * 0.1).x > 100.0, "+x is on the right of a camera on +z");
        assert!(at(Vec3::Y * 0.1).y < 50.0, "+y is in the upper half");
    }

    #[test]
    fn an_orbit_looks_from_all_sides() {
        let mesh = box_mesh();
        let cameras = Camera::orbit(&mesh, 8, 1.0);
        let mean: DVec3 = cameras.iter().map(|c| (c.eye - c.target).normalize()).sum::<DVec3>() / 8.0;
        assert!(mean.length() < 0.2, "{mean}");
        assert!(cameras.iter().all(|c| c.defect().is_none()));
    }
}

mod lamp_view {
    use fantex_scene::{LampView, Spread};
    use glam::{DVec2, DVec3, Vec3};

    fn views() -> [LampView; 2] {
        let (origin, forward) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-0.4, -0.5, -1.0));
        [Spread::Perspective, Spread::Parallel]
            .map(|spread| LampView::new(origin, forward, DVec3::Y, DVec2::new(0.8, 0.5), spread))
    }

    #[test]
    fn the_matrix_projects() {
        for view in views() {
            let p = Vec3::new(0.2, 0.4, 0.1);
            let (h, seen) = (view.matrix() * p.as_dvec3().extend(1.0), view.project(p));
            assert!((h.truncate().truncate() / h.z - seen.uv).length() < 1e-12);
            assert!((h.z - seen.w).abs() < 1e-12 && (h.w - seen.depth).abs() < 1e-12);
        }
    }

    #[test]
    fn steps_and_slopes_are_the_limits_of_differences() {
        for view in views() {
            let (p, normal) = (Vec3::new(0.2, 0.4, 0.1), DVec3::new(0.3, 1.0, 0.2).normalize());
            let at = view.project(p);
            let step = Vec3::new(1e-3, -2e-3, 5e-4);
            let step = step - normal.as_vec3() * step.dot(normal.as_vec3());
            let there = view.project(p + step);
            let moved = (there.uv - at.uv).as_vec2();
            assert!((moved - view.step(&at, step)).length() < 1e-5, "{moved}");
            let slope = view.plane_slope(p.as_dvec3(), normal).dot(there.uv - at.uv);
            let change = match view.spread() {
                Spread::Perspective => 1.0 / there.depth - 1.0 / at.depth,
                Spread::Parallel => there.depth - at.depth,
            };
            assert!((slope - change).abs() < 1e-6, "{slope} against {change}");
        }
    }
}
