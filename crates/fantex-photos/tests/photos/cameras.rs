//! Files of cameras: what is written is read again, what is wrong is said, and nothing panics.

use std::fs;
use std::path::Path;

use fantex_base::{ReadLimits, ReadOptions, Result};
use fantex_photos::{
    CameraFrame, CameraFromWorld, Distortion, Lens, PhotoCamera, Photograph, read_cameras,
    write_colmap_binary, write_colmap_text, write_transforms,
};
use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;

fn cameras_of(path: &Path, images: Option<&Path>) -> Result<Vec<Photograph>> {
    read_cameras(path, images, CameraFrame::OfFile)
}

fn lenses() -> [Lens; 3] {
    [
        Distortion::PINHOLE,
        Distortion::Perspective { radial: [-0.1, 0.02, 0.0, 0.0, 0.0, 0.0], tangential: [1e-3, -2e-3] },
        Distortion::Perspective {
            radial: [-0.1, 0.02, 0.003, 0.01, -0.02, 0.001],
            tangential: [1e-3, -2e-3],
        },
    ]
    .map(Lens::new)
}

/// Lenses that only COLMAP's files can hold.
fn rare_lenses() -> [Lens; 2] {
    [
        Distortion::FieldOfView { omega: 0.9 },
        Distortion::Fisheye {
            radial: [0.1, -0.02, 0.003, 0.1],
            tangential: [1e-3, -2e-3],
            prism: [3e-3, 4e-3],
        },
    ]
    .map(Lens::new)
}

/// Cameras that differ in everything. Their pictures lie in `folder`.
fn set(folder: &Path, lenses: &[Lens]) -> Vec<Photograph> {
    fs::create_dir_all(folder).unwrap();
    (0..6)
        .map(|i| {
            let name = format!("photo {i}.png");
            fs::write(folder.join(&name), b"not looked at").unwrap();
            let eye = DVec3::new(3.0 + i as f64, 1.5 - i as f64, 2.0 * i as f64 - 5.0);
            let mut camera = PhotoCamera::pinhole([640 + i as u32, 480], 500.25 + i as f64);
            camera.focal.y += 2.5;
            camera.center += DVec2::new(3.5, -1.25);
            camera.lens = lenses[i % lenses.len()];
            Photograph {
                path: folder.join(&name),
                mask: None,
                name,
                camera,
                camera_from_world: CameraFromWorld::looking_at(eye, DVec3::new(0.1, 0.2, 0.3), DVec3::Y),
            }
        })
        .collect()
}

fn assert_alike(read: &[Photograph], written: &[Photograph]) {
    assert_eq!(read.len(), written.len());
    for (read, written) in read.iter().zip(written) {
        assert!(read.name.ends_with(&written.name), "{} {}", read.name, written.name);
        assert_eq!(read.path.canonicalize().unwrap(), written.path.canonicalize().unwrap());
        assert_eq!(read.camera, written.camera);
        let turn = read.camera_from_world.rotation - written.camera_from_world.rotation;
        assert!(turn.to_cols_array().iter().all(|d| d.abs() < 1e-12));
        assert!(read.camera_from_world.eye().distance(written.camera_from_world.eye()) < 1e-10);
    }
}

/// The folders of a set: pictures, sparse model.
fn folders(root: &Path) -> [std::path::PathBuf; 2] {
    let sparse = root.join("sparse/0");
    fs::create_dir_all(&sparse).unwrap();
    [root.join("images"), sparse]
}

#[test]
fn what_is_written_is_read_again() {
    let root = tempfile::tempdir().unwrap();
    let [images, sparse] = folders(root.path());
    let written = set(&images, &lenses());
    let transforms = root.path().join("transforms.json");
    write_transforms(&transforms, &written, "images").unwrap();
    assert_alike(&cameras_of(&transforms, None).unwrap(), &written);
    assert_alike(&cameras_of(root.path(), None).unwrap(), &written);
    write_colmap_text(&sparse, &written).unwrap();
    for path in [root.path(), &sparse] {
        assert_alike(&cameras_of(path, None).unwrap(), &written);
    }
    // Binary files go before text.
    write_colmap_binary(&sparse, &written).unwrap();
    fs::write(sparse.join("cameras.txt"), "rubbish").unwrap();
    assert_alike(&cameras_of(&sparse, Some(&images)).unwrap(), &written);
    let fisheyes = set(&images, &[Lens::new(Distortion::fisheye([0.1, -0.02, 0.003, 0.0]))]);
    write_transforms(&transforms, &fisheyes, "images").unwrap();
    assert_alike(&cameras_of(&transforms, None).unwrap(), &fisheyes);
    write_colmap_binary(&sparse, &fisheyes).unwrap();
    assert_alike(&cameras_of(root.path(), None).unwrap(), &fisheyes);
    let mixed: Vec<_> = [&written[..1], &fisheyes[..1]].concat();
    assert!(write_transforms(&transforms, &mixed, "images").unwrap_err().to_string().contains("fisheyes"));
    let rare = set(&images, &rare_lenses());
    write_colmap_binary(&sparse, &rare).unwrap();
    assert_alike(&cameras_of(&sparse, Some(&images)).unwrap(), &rare);
    fs::remove_file(sparse.join("cameras.bin")).unwrap();
    write_colmap_text(&sparse, &rare).unwrap();
    assert_alike(&cameras_of(&sparse, Some(&images)).unwrap(), &rare);
    for photograph in &rare[..2] {
        let refused = write_transforms(&transforms, std::slice::from_ref(photograph), "images");
        assert!(refused.unwrap_err().to_string().contains("thin prisms"));
    }
}

#[test]
fn masks_are_found_where_others_put_them() {
    let root = tempfile::tempdir().unwrap();
    let [images, sparse] = folders(root.path());
    let written = set(&images, &lenses());
    write_colmap_text(&sparse, &written).unwrap();
    let masks = root.path().join("masks");
    fs::create_dir_all(&masks).unwrap();
    fs::write(masks.join("photo 1.png.png"), b"not looked at").unwrap();
    let masked = |photographs: &[Photograph]| -> Vec<bool> {
        photographs.iter().map(|photograph| photograph.mask.is_some()).collect()
    };
    let read = cameras_of(root.path(), None).unwrap();
    assert_eq!(masked(&read).iter().filter(|&&is_masked| is_masked).count(), 1);
    assert_eq!(read[1].mask.as_ref().unwrap(), &masks.join("photo 1.png.png"));
    // By name, in a transforms.json.
    let transforms = root.path().join("transforms.json");
    write_transforms(&transforms, &written, "images").unwrap();
    let mut json: serde_json::Value = serde_json::from_slice(&fs::read(&transforms).unwrap()).unwrap();
    json["frames"][0]["mask_path"] = "masks/photo 1.png.png".into();
    fs::write(&transforms, json.to_string()).unwrap();
    assert!(masked(&cameras_of(&transforms, None).unwrap())[0]);
    json["frames"][0]["mask_path"] = "masks/none.png".into();
    fs::write(&transforms, json.to_string()).unwrap();
    let error = cameras_of(&transforms, None).unwrap_err().to_string();
    assert!(error.contains("masks/none.png is missing"), "{error}");
}

/// A world that nerfstudio has turned (and another program has scaled) is turned back.
#[test]
fn an_applied_transform_is_undone_on_request() {
    let root = tempfile::tempdir().unwrap();
    let [images, _] = folders(root.path());
    let original = set(&images, &lenses()[..1]);
    // x, y, z become x, z, -y; then all moves by (0, 0, 2) and doubles.
    let (turn, shift, scale) =
        (DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y), DVec3::new(0.0, 0.0, 2.0), 2.0);
    let moved: Vec<Photograph> = original
        .iter()
        .map(|photograph| {
            let CameraFromWorld { rotation, translation } = photograph.camera_from_world;
            let rotation = rotation * turn.transpose();
            let translation = scale * (translation - rotation * shift);
            Photograph { camera_from_world: CameraFromWorld { rotation, translation }, ..photograph.clone() }
        })
        .collect();
    let path = root.path().join("transforms.json");
    write_transforms(&path, &moved, "images").unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let with = |applied: &str| fs::write(&path, text.replacen('{', &format!("{{{applied}"), 1)).unwrap();
    with(r#""applied_transform":[[1,0,0,0],[0,0,1,0],[0,-1,0,2]],"applied_scale":2,"#);
    assert_alike(&cameras_of(&path, None).unwrap(), &moved);
    let read = read_cameras(root.path(), None, CameraFrame::Original).unwrap();
    for (read, original) in read.iter().zip(&original) {
        let (a, b) = (read.camera_from_world, original.camera_from_world);
        assert!((a.eye() - b.eye()).length() < 1e-9, "{} {}", a.eye(), b.eye());
        assert!((a.rotation - b.rotation).to_cols_array().iter().all(|e| e.abs() < 1e-9));
    }
    with(r#""applied_transform":[[2,0,0,0],[0,0,1,0],[0,-1,0,2]],"#);
    assert!(cameras_of(&path, None).is_ok());
    let refused = read_cameras(&path, None, CameraFrame::Original).unwrap_err().to_string();
    assert!(refused.contains("applied_transform is not a rotation"), "{refused}");
}

#[test]
fn colmap_texts_are_read_as_they_come() {
    let root = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(root.path().join(name), text).unwrap();
    fs::create_dir(root.path().join("images")).unwrap();
    for name in ["b 1.jpg", "a.jpg"] {
        fs::write(root.path().join("images").join(name), b"").unwrap();
    }
    write("cameras.txt", "# comment\n\n3 SIMPLE_RADIAL 100 80 90.5 50 40 -0.01\r\n");
    // A line of points, then an empty one, then none.
    write(
        "images.txt",
        "# c\n7 1 0 0 0 0 0 2 3 b 1.jpg\n1.5 2.5 -1 3 4 17\n\n9 0.5 0.5 0.5 0.5 1 2 3 3 a.jpg\n",
    );
    let read = cameras_of(root.path(), None).unwrap();
    assert_eq!(read.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["a.jpg", "b 1.jpg"]);
    assert_eq!(read[1].camera_from_world.eye(), DVec3::new(0.0, 0.0, -2.0));
    assert_eq!(read[1].camera.focal, DVec2::splat(90.5));
    // The quaternion (1,1,1,1)/2 turns x to y to z to x.
    let turned = read[0].camera_from_world.rotation * DVec3::X;
    assert!(turned.distance(DVec3::Y) < 1e-12);
    let cases = [
        ("cameras.txt", "1 EUCM 10 10 1 2 3 4 5\n", "line 1: the camera model 'EUCM' is not supported"),
        ("cameras.txt", "1 PINHOLE 10 10 1 2 3\n", "line 1: PINHOLE has 4 parameters, not 3"),
        ("cameras.txt", "\n1 PINHOLE ten 10 1 1 5 5\n", "line 2: expected the width in pixels, found 'ten'"),
        ("cameras.txt", "1 PINHOLE 9 9 1 1 5 5\n1 PINHOLE 9 9 1 1 5 5\n", "line 2: there are two cameras 1"),
        ("images.txt", "1 1 0 0 0 0 0 2 4 x.jpg\n", "'x.jpg' is of camera 4"),
        ("images.txt", "1 1 0 0 0 0 0 2 3\n", "name of a photograph is empty"),
        ("images.txt", "1 0 0 0 0 0 0 2 3 x.jpg\n", "quaternion is zero"),
        ("images.txt", "1 1 0 0\n", "expected QW QX QY QZ"),
        ("images.txt", "# nothing\n", "names no photograph"),
        ("images.txt", "1 1 0 0 0 0 0 2 3 gone.jpg\n", "1 of 1 photograph is missing"),
    ];
    let [cameras, images] = ["cameras.txt", "images.txt"].map(|n| fs::read(root.path().join(n)).unwrap());
    for (file, text, expected) in cases {
        fs::write(root.path().join("cameras.txt"), &cameras).unwrap();
        fs::write(root.path().join("images.txt"), &images).unwrap();
        write(file, text);
        let message = cameras_of(root.path(), None).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let empty = tempfile::tempdir().unwrap();
    assert!(cameras_of(empty.path(), None).unwrap_err().to_string().contains("holds no cameras"));
    assert!(cameras_of(&empty.path().join("no"), None).unwrap_err().to_string().contains("cannot read"));
}

#[test]
fn transforms_of_other_programs_are_read() {
    let root = tempfile::tempdir().unwrap();
    let file = root.path().join("transforms_train.json");
    let picture = fantex_texture::Image::from_linear(40, 20, 3, vec![0.5; 40 * 20 * 3]);
    fs::create_dir(root.path().join("train")).unwrap();
    picture.save(root.path().join("train/r_0.png")).unwrap();
    // NeRF's synthetic sets: an angle, no size, no extension.
    let matrix = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let text = format!(
        r#"{{"camera_angle_x": 1.5707963267948966, "frames": [{{"file_path": "./train/r_0", "rotation": 0.01,
            "transform_matrix": {matrix}}}]}}"#
    );
    fs::write(&file, &text).unwrap();
    let read = cameras_of(&file, None).unwrap();
    assert!((read[0].camera.focal - 20.0).abs().max_element() < 1e-9);
    assert_eq!(read[0].camera.center, DVec2::new(20.0, 10.0));
    // The camera looks along -z: what is in front of it is seen in the middle, +y above.
    let pose = read[0].camera_from_world;
    assert_eq!(pose.eye(), DVec3::new(0.0, 0.0, 4.0));
    let seen = |p: DVec3| read[0].camera.project(pose.rotation * p + pose.translation).unwrap().pixel;
    assert!(seen(DVec3::ZERO).distance(DVec2::new(20.0, 10.0)) < 1e-9);
    assert!(seen(DVec3::Y).y < 10.0 && seen(DVec3::X).x > 20.0);
    assert_eq!(cameras_of(&file, Some(&root.path().join("train"))).unwrap().len(), 1);
    let wrong = |from: &str, to: &str, expected: &str| {
        fs::write(&file, text.replacen(from, to, 1)).unwrap();
        let message = cameras_of(&file, None).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    };
    wrong(r#""camera_angle_x": 1.5707963267948966, "#, "", "frame 0: there is no focal length");
    wrong("[1,0,0,0]", "[2,0,0,0]", "frame 0: the camera's place");
    wrong("[1,0,0,0]", "[-1,0,0,0]", "right-handed");
    wrong("[1,0,0,0]", "[1,0,0]", "four rows of four");
    wrong(
        "\"frames\"",
        "\"camera_model\": \"EQUIRECTANGULAR\", \"frames\"",
        "'EQUIRECTANGULAR' is not supported",
    );
    for name in ["FOV", "THIN_PRISM_FISHEYE"] {
        fs::write(
            &file,
            text.replacen("\"frames\"", &format!("\"camera_model\": \"{name}\", \"frames\""), 1),
        )
        .unwrap();
        let message = cameras_of(&file, None).unwrap_err().to_string();
        assert!(message.contains(&format!("'{name}' is not supported")), "{message}");
        assert!(message.contains("COLMAP's files hold FOV and THIN_PRISM_FISHEYE, too"), "{message}");
        // What it lists as known is known.
        let (_, known) = message.split_once("(known: ").unwrap();
        let (known, _) = known.split_once(';').unwrap();
        assert_eq!(known.split(", ").count(), 9);
        for known in known.split(", ") {
            fs::write(
                &file,
                text.replacen("\"frames\"", &format!("\"camera_model\": \"{known}\", \"frames\""), 1),
            )
            .unwrap();
            cameras_of(&file, None).unwrap();
        }
    }
    wrong("\"frames\"", "\"w\": 1e30, \"h\": 20, \"frames\"", "a side must be");
    wrong("train/r_0", "train/r_9", "r_9");
    wrong("\"frames\"", "\"frame\"", "the key 'frames' is missing");
    wrong("1.57", "oops", "line 1");
    fs::write(&file, r#"{"frames": []}"#).unwrap();
    assert!(cameras_of(&file, None).unwrap_err().to_string().contains("names no photograph"));
}

/// A pipe without a writer would keep whoever opens it.
#[cfg(unix)]
#[test]
fn sizes_are_not_read_from_pipes_nor_from_rubbish() {
    let root = tempfile::tempdir().unwrap();
    let file = root.path().join("transforms.json");
    let matrix = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let pipe = root.path().join("a.png");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    fs::write(root.path().join("b.png"), b"\x89PNG\r\n\x1a\n rubbish").unwrap();
    for (name, expected) in [("a.png", "a device or a pipe"), ("b.png", "cannot be read")] {
        let frame = format!(r#"{{"file_path": "{name}", "transform_matrix": {matrix}}}"#);
        fs::write(&file, format!(r#"{{"fl_x": 20, "frames": [{frame}]}}"#)).unwrap();
        let (sender, receiver) = std::sync::mpsc::channel();
        let file = file.clone();
        std::thread::spawn(move || sender.send(cameras_of(&file, None).unwrap_err().to_string()));
        let message = receiver.recv_timeout(std::time::Duration::from_secs(60)).unwrap();
        assert!(message.contains(expected) && message.contains(name), "{message}");
    }
}

#[test]
fn fisheyes_of_instant_ngp_are_told_by_a_flag() {
    let root = tempfile::tempdir().unwrap();
    let file = root.path().join("transforms.json");
    fs::write(root.path().join("a.png"), []).unwrap();
    let lens = |camera: &str| {
        let text = format!(
            r#"{{"w": 40, "h": 20, "fl_x": 20, "k1": 0.1, "k2": 0.02, "k3": 0.003, "k4": 0.0004, {camera} "frames":
                [{{"file_path": "a.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}}]}}"#
        );
        fs::write(&file, text).unwrap();
        cameras_of(&file, None).unwrap()[0].camera.lens.distortion()
    };
    assert_eq!(lens(r#""is_fisheye": true,"#), Distortion::fisheye([0.1, 0.02, 0.003, 0.0004]));
    let perspective =
        Distortion::Perspective { radial: [0.1, 0.02, 0.003, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
    assert_eq!(lens(""), perspective);
    assert_eq!(lens(r#""is_fisheye": false,"#), perspective);
    assert_eq!(lens(r#""is_fisheye": true, "camera_model": "OPENCV","#), perspective);
}

/// A small set as files: names and bytes.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let root = tempfile::tempdir().unwrap();
    let [images, sparse] = folders(root.path());
    let written = set(&images, &lenses());
    write_colmap_text(&sparse, &written).unwrap();
    write_colmap_binary(&sparse, &written).unwrap();
    write_transforms(&sparse.join("transforms.json"), &written, "images").unwrap();
    ["cameras.bin", "images.bin", "cameras.txt", "images.txt", "transforms.json"]
        .map(|name| (name, fs::read(sparse.join(name)).unwrap()))
        .to_vec()
}

/// Puts damaged bytes in the place of one file of a set and reads it. Photographs must be sound, errors must name the file.
fn read_damaged(samples: &[(&'static str, Vec<u8>)], name: &str, bytes: &[u8]) -> Result<(), String> {
    let root = tempfile::tempdir().unwrap();
    let kind = name.rsplit('.').next().unwrap_or_default();
    for (other, content) in samples.iter().filter(|(other, _)| other.ends_with(kind)) {
        let content = if *other == name { bytes } else { content };
        fs::write(root.path().join(other), content).unwrap();
    }
    match cameras_of(root.path(), None) {
        Ok(photographs) => {
            for photograph in photographs {
                let camera = photograph.camera;
                let sound = camera.focal.is_finite()
                    && camera.focal.min_element() > 0.0
                    && camera.size.iter().all(|&side| side > 0)
                    && photograph.camera_from_world.eye().is_finite();
                assert!(sound, "{photograph:?}");
                // Any point may be projected.
                let _seen = camera.project(DVec3::new(0.3, -0.2, 1.0));
            }
            Ok(())
        }
        Err(error) => Err(error.to_string()),
    }
}

#[test]
fn files_cut_off_at_any_byte_are_refused_or_sound() {
    let samples = samples();
    for (name, bytes) in &samples {
        for length in (0..bytes.len()).step_by(7) {
            let outcome = read_damaged(&samples, name, &bytes[..length]);
            // Binary files state their lengths: every truncation is noticed.
            assert!(
                !name.ends_with(".bin") || outcome.is_err_and(|e| e.contains("the file ends here")),
                "{length}"
            );
        }
    }
}

#[test]
fn binary_files_end_after_what_they_count() {
    let samples = samples();
    for (name, what) in [("cameras.bin", "camera"), ("images.bin", "photograph")] {
        let mut bytes = samples.iter().find(|s| s.0 == name).unwrap().1.clone();
        bytes.push(0);
        let message = read_damaged(&samples, name, &bytes).unwrap_err();
        assert!(message.contains(&format!("goes on after the last {what}")), "{message}");
    }
}

#[test]
fn absurd_counts_are_refused_before_memory_is_taken() {
    let samples = samples();
    for name in ["cameras.bin", "images.bin"] {
        for count in [1_u64 << 17, 1 << 40, u64::MAX] {
            let mut bytes = samples.iter().find(|s| s.0 == name).unwrap().1.clone();
            bytes[..8].copy_from_slice(&count.to_le_bytes());
            assert!(read_damaged(&samples, name, &bytes).unwrap_err().contains("more than 65536"));
        }
    }
    // A photograph that sees 2^60 points.
    let mut bytes = samples[1].1.clone();
    let last = bytes.len() - 8;
    bytes[last..].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    assert!(read_damaged(&samples, "images.bin", &bytes).unwrap_err().contains("points of a photograph"));
    // A name without an end.
    let mut bytes = samples[1].1[..72].to_vec();
    bytes.resize(10_000, b'x');
    assert!(read_damaged(&samples, "images.bin", &bytes).unwrap_err().contains("longer than 4096"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_are_refused_or_sound(
        sample in 0usize..5,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let samples = samples_once();
        let (name, mut bytes) = samples[sample].clone();
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        if let Err(message) = read_damaged(samples, name, &bytes) {
            prop_assert!(!message.is_empty() && !message.contains('\n'), "{}", message);
        }
    }

    #[test]
    fn noise_is_refused_or_sound(sample in 0usize..5, noise in prop::collection::vec(any::<u8>(), 0..400)) {
        let samples = samples_once();
        let _outcome = read_damaged(samples, samples[sample].0, &noise);
    }

    #[test]
    fn lenses_of_any_numbers_never_see_what_is_not_finite(
        k in prop::array::uniform6(-2.0f64..2.0),
        p in prop::array::uniform2(-0.1f64..0.1),
        at in prop::array::uniform3(-3.0f64..3.0),
    ) {
        for distortion in [
            Distortion::Perspective { radial: k, tangential: p },
            Distortion::Fisheye { radial: [k[0], k[1], k[2], k[3]], tangential: p, prism: [k[4], k[5]] },
            Distortion::FieldOfView { omega: k[0] },
        ] {
            let lens = Lens::new(distortion);
            if let Some(seen) = lens.project(DVec3::from(at)) {
                prop_assert!(seen.position.is_finite() && seen.room > 0.0 && seen.room <= 1.0);
            }
            if let Some(direction) = lens.direction(DVec2::new(at[0], at[1])) {
                prop_assert!((direction.length() - 1.0).abs() < 1e-9);
            }
        }
    }
}

fn samples_once() -> &'static [(&'static str, Vec<u8>)] {
    static SAMPLES: std::sync::OnceLock<Vec<(&'static str, Vec<u8>)>> = std::sync::OnceLock::new();
    SAMPLES.get_or_init(samples)
}

const BARREL: Distortion =
    Distortion::Perspective { radial: [-0.2, 0.03, 0.0, 0.0, 0.0, 0.0], tangential: [0.001, -0.002] };
const FISHEYE: Distortion = Distortion::fisheye([-0.02, 0.003, -0.001, 0.0]);
const PRISM: Distortion =
    Distortion::Fisheye { radial: [0.1, -0.05, 0.0, 0.0], tangential: [0.002, -0.001], prism: [0.01, -0.02] };
const FIELD_OF_VIEW: Distortion = Distortion::FieldOfView { omega: 0.9 };

#[test]
fn distortion_is_that_of_the_formulas() {
    // By hand: n = (0.3, -0.2), r^2 = 0.13; radial 1 - 0.2*0.13 + 0.03*0.0169 = 0.974507;
    // x: 0.2923521 + 2*0.001*(-0.06) - 0.002*(0.13 + 0.18), y: -0.1949014 + 0.001*(0.13 + 0.08) - 2*0.002*(-0.06).
    let seen = Lens::new(BARREL).project(DVec3::new(0.6, -0.4, 2.0)).unwrap();
    assert!((seen.position - DVec2::new(0.2916121, -0.1944514)).length() < 1e-7, "{seen:?}");
    // theta = atan(0.5): 0.46364761; radius theta (1 - 0.02 t2 + 0.003 t4 - 0.001 t6).
    let seen = Lens::new(FISHEYE).project(DVec3::new(0.0, 1.0, 2.0)).unwrap();
    let t2 = 0.463_647_61_f64.powi(2);
    let radius = 0.463_647_61 * (1.0 - 0.02 * t2 + 0.003 * t2 * t2 - 0.001 * t2 * t2 * t2);
    assert!((seen.position - DVec2::new(0.0, radius)).length() < 1e-8);
    // theta = atan(0.5), along (0.6, 0.8); n = theta * (0.6, 0.8) = (0.27818857, 0.37091809), r^2 = 0.21496911; radial
    // 1 + 0.1 * 0.21496911 - 0.05 * 0.04621172 = 1.01918633; x: 0.28352596 + 2 * 0.002 * 0.10318517
    // - 0.001 * (0.21496911 + 0.15477776) + 0.01 * 0.21496911, y: 0.37803465 + 0.002 * (0.21496911 + 0.27516046)
    // - 2 * 0.001 * 0.10318517 - 0.02 * 0.21496911.
    let seen = Lens::new(PRISM).project(DVec3::new(0.6, 0.8, 2.0)).unwrap();
    assert!((seen.position - DVec2::new(0.285_718_65, 0.374_509_16)).length() < 1e-7, "{seen:?}");
    // At r = 0.5, atan(2 * 0.5 * tan(0.45)) / 0.9 = atan(0.48305507) / 0.9 = 0.5.
    let seen = Lens::new(FIELD_OF_VIEW).project(DVec3::new(0.0, 1.0, 2.0)).unwrap();
    assert!((seen.position - DVec2::new(0.0, 0.5)).length() < 1e-12, "{seen:?}");
    let seen = Lens::new(FIELD_OF_VIEW).project(DVec3::new(1.0, 0.0, 1.0)).unwrap();
    assert!((seen.position.x - (2.0 * 0.45_f64.tan()).atan() / 0.9).abs() < 1e-12, "{seen:?}");
    for omega in [0.0, 1e-9, -1e-9] {
        let seen = Lens::new(Distortion::FieldOfView { omega }).project(DVec3::new(1.0, 2.0, 4.0)).unwrap();
        assert!((seen.position - DVec2::new(0.25, 0.5)).length() < 1e-12, "{omega}");
    }
    let pinhole = Lens::new(Distortion::PINHOLE).project(DVec3::new(1.0, 2.0, 4.0)).unwrap();
    assert_eq!(pinhole.position, DVec2::new(0.25, 0.5));
}

#[test]
fn the_way_back_is_the_way() {
    for distortion in [Distortion::PINHOLE, BARREL, FISHEYE, PRISM, FIELD_OF_VIEW] {
        let lens = Lens::new(distortion);
        for i in 0..200_u32 {
            let angle = f64::from(i) * 2.399;
            let off = 0.8 * f64::from(i) / 200.0;
            let direction = DVec3::new(off.sin() * angle.cos(), off.sin() * angle.sin(), off.cos());
            let back = lens.direction(lens.project(direction).unwrap().position).unwrap();
            assert!((back - direction).length() < 1e-9, "{distortion:?} {i}");
        }
    }
}

#[test]
fn polynomials_do_not_fold_back() {
    // r (1 - 0.3 r^2) grows up to r = 1.054, and would bring r = 1.8 back to 0.05.
    let lens =
        Lens::new(Distortion::Perspective { radial: [-0.3, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] });
    let room = lens.project(DVec3::new(1.0, 0.0, 1.0)).unwrap().room;
    assert!(room < 0.06 && (1.0 / (1.0 - room) - (1.0_f64 / 0.9).sqrt()).abs() < 2e-3, "{room}");
    assert_eq!(lens.project(DVec3::new(1.8, 0.0, 1.0)), None);
    assert_eq!(lens.project(DVec3::new(0.1, 0.0, -1.0)), None);
    // Nothing is seen where the lens reaches no more.
    assert_eq!(lens.direction(DVec2::new(0.9, 0.0)), None);
    // A fisheye sees behind.
    assert!(Lens::new(Distortion::fisheye([0.0; 4])).project(DVec3::new(1.0, 0.0, -0.2)).is_some());
    assert_eq!(Lens::new(Distortion::fisheye([0.0; 4])).project(DVec3::NEG_Z), None);
}

#[test]
fn cameras_look_where_they_are_told_to() {
    let pose = CameraFromWorld::looking_at(DVec3::new(0.0, 1.0, 5.0), DVec3::new(0.0, 1.0, 0.0), DVec3::Y);
    assert!((pose.eye() - DVec3::new(0.0, 1.0, 5.0)).length() < 1e-12);
    assert!((pose.rotation.determinant() - 1.0).abs() < 1e-12);
    let seen = |p: DVec3| {
        let camera = PhotoCamera::pinhole([200, 100], 100.0);
        camera.project(pose.rotation * p + pose.translation).unwrap().pixel
    };
    assert!((seen(DVec3::new(0.0, 1.0, 0.0)) - DVec2::new(100.0, 50.0)).length() < 1e-9);
    assert!(seen(DVec3::new(1.0, 1.0, 0.0)).x > 100.0, "+x is on the right of a camera on +z");
    assert!(seen(DVec3::new(0.0, 2.0, 0.0)).y < 50.0, "up is up");
}

/// The camera of COLMAP's text files with one photograph, whose pose is `pose`.
fn camera_of(camera: &str, pose: &str) -> Result<Photograph> {
    let root = tempfile::tempdir().unwrap();
    fs::create_dir(root.path().join("images")).unwrap();
    fs::write(root.path().join("images/a.png"), b"").unwrap();
    fs::write(root.path().join("cameras.txt"), format!("1 {camera}\n")).unwrap();
    fs::write(root.path().join("images.txt"), format!("1 {pose} 1 a.png\n\n")).unwrap();
    cameras_of(root.path(), None).map(|mut photographs| photographs.remove(0))
}

const UPRIGHT: &str = "1 0 0 0 0 0 0";

#[test]
fn parameters_mean_what_the_models_say() {
    let camera = camera_of("FULL_OPENCV 8 6 1 2 3 4 5 6 7 8 9 10 11 12", UPRIGHT).unwrap().camera;
    assert_eq!((camera.focal, camera.center), (DVec2::new(1.0, 2.0), DVec2::new(3.0, 4.0)));
    let expected =
        Distortion::Perspective { radial: [5.0, 6.0, 9.0, 10.0, 11.0, 12.0], tangential: [7.0, 8.0] };
    assert_eq!(camera.lens.distortion(), expected);
    let prism = camera_of("THIN_PRISM_FISHEYE 8 6 1 2 3 4 5 6 7 8 9 10 11 12", UPRIGHT).unwrap().camera;
    let expected =
        Distortion::Fisheye { radial: [5.0, 6.0, 9.0, 10.0], tangential: [7.0, 8.0], prism: [11.0, 12.0] };
    assert_eq!(prism.lens.distortion(), expected);
    for (model, parameters, focals) in [
        ("SIMPLE_PINHOLE", 3, 1),
        ("PINHOLE", 4, 2),
        ("SIMPLE_RADIAL", 4, 1),
        ("RADIAL", 5, 1),
        ("OPENCV", 8, 2),
        ("OPENCV_FISHEYE", 8, 2),
        ("FULL_OPENCV", 12, 2),
        ("FOV", 5, 2),
        ("SIMPLE_RADIAL_FISHEYE", 4, 1),
        ("RADIAL_FISHEYE", 5, 1),
        ("THIN_PRISM_FISHEYE", 12, 2),
    ] {
        let rest = " 0.01".repeat(parameters - 2);
        let camera = camera_of(&format!("{model} 8 6 500 501{rest}"), UPRIGHT).unwrap().camera;
        assert_eq!(camera.focal.x, 500.0);
        assert_eq!(camera.focal.y == 501.0, focals == 2, "{model}");
    }
}

#[test]
fn bad_cameras_are_refused_in_a_sentence() {
    for (camera, sentence) in [
        ("EUCM 8 6 1 1 4 3", "'EUCM' is not supported"),
        ("FOV 8 6 1 1 4 3 3.2", "far out of range"),
        ("PINHOLE 8 6 1 1 1", "4 parameters, not 3"),
        ("PINHOLE 0 6 1 1 1 1", "0 x 6 pixels"),
        ("PINHOLE 8 18446744073709551615 1 1 1 1", "1 to 65536"),
        ("PINHOLE 8 6 NaN 1 1 1", "not finite"),
        ("PINHOLE 8 6 -1 1 1 1", "above 0"),
    ] {
        let message = camera_of(camera, UPRIGHT).unwrap_err().to_string();
        assert!(message.contains(sentence), "{camera}: {message}");
    }
    assert!(camera_of("PINHOLE 8 6 1 1 1 1", "0 0 0 0 0 0 0").is_err());
    assert!(camera_of("PINHOLE 8 6 1 1 1 1", "2 0 0 0 inf inf inf").is_err());
    let scaled = camera_of("PINHOLE 8 6 1 1 1 1", "2 0 0 0 1 1 1").unwrap();
    assert_eq!(scaled.camera_from_world.rotation, DMat3::IDENTITY);
}

#[test]
fn names_lead_out_of_no_folder() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("set");
    fs::create_dir_all(folder.join("images")).unwrap();
    fs::write(root.path().join("secret.png"), b"not looked at").unwrap();
    fs::write(folder.join("images/secret.png"), b"not looked at").unwrap();
    let secret = root.path().join("secret.png").display().to_string();
    fs::write(folder.join("cameras.txt"), "1 PINHOLE 8 6 1 1 4 3\n").unwrap();
    let refused = |result: Result<Vec<Photograph>>| result.unwrap_err().to_string();
    for name in ["../../secret.png", &secret] {
        fs::write(folder.join("images.txt"), format!("1 {UPRIGHT} 1 {name}\n\n")).unwrap();
        let sentence = refused(cameras_of(&folder, None));
        assert!(sentence.contains("--allow-outside") && sentence.contains("secret.png"), "{sentence}");
    }
    let transforms = folder.join("transforms.json");
    let write = |name: &str, mask: &str| {
        let frame = format!(
            r#"{{"file_path": "{name}"{mask}, "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"#
        );
        fs::write(&transforms, format!(r#"{{"w": 8, "h": 6, "fl_x": 5, "frames": [{frame}]}}"#)).unwrap();
    };
    for (name, mask) in
        [("../secret.png", ""), (&secret, ""), ("images/secret.png", r#", "mask_path": "../secret.png""#)]
    {
        write(name, mask);
        assert!(refused(cameras_of(&transforms, None)).contains("--allow-outside"), "{name}");
    }
    // Where photographs have a folder of their own, only that is looked at.
    write(&secret, "");
    let images = folder.join("images");
    let found = cameras_of(&transforms, Some(&images)).unwrap();
    assert_eq!(found[0].path, images.join("secret.png"));
    let options = ReadOptions { allow_outside: true, ..ReadOptions::default() };
    let found = ReadLimits::new(options).run(|| cameras_of(&transforms, None)).unwrap();
    assert_eq!(found[0].path, Path::new(&secret));
}
