//! Photographs as a source: a set is taken, baked from each kind of file, and compared with what was photographed.

use fantex::texture::FilterOptions;
use std::path::Path;
use std::sync::Arc;

use fantex::bake::{LookSource, Source, TexelPoint};
use fantex::mesh::{CleanOptions, LoadOptions, SurfacePoint, clean, load};
use fantex::store::{Asset, Footprint, PageCache, Sampler};
use fantex::texture::color::srgb_from_linear;
use glam::{Vec3, Vec4};

use crate::{bottle, fails, files, json, stderr, succeeds, write};

/// Differences of the asset's base colour from the model's own, sRGB, at the middles of the triangles, ascending.
fn differences(asset: &Path) -> Vec<f32> {
    let (mesh, _) =
        clean(load(&bottle(), &LoadOptions::default()).unwrap(), &CleanOptions::default()).unwrap();
    let truth = LookSource::of_model(&mesh).unwrap();
    let cache = PageCache::new(Arc::new(Asset::open(asset).unwrap()), 64 << 20);
    let sampler = Sampler::of_cache(&cache, FilterOptions::default());
    let lambda = Vec3::splat(1.0 / 3.0);
    let encoded = |color: Vec4| color.truncate().map(|c| srgb_from_linear(c.clamp(0.0, 1.0)));
    let mut differences: Vec<f32> = (0..mesh.triangles.len())
        .map(|triangle| {
            let corners = mesh.triangle_positions(triangle);
            let mut values = vec![Vec4::ZERO; truth.channels().len()];
            let point = TexelPoint {
                at: SurfacePoint { triangle: triangle as u32, lambda },
                lambda_steps: [Vec3::new(-0.1, 0.1, 0.0), Vec3::new(-0.1, 0.0, 0.1)],
                position: (corners[0] + corners[1] + corners[2]) / 3.0,
                position_steps: [(corners[1] - corners[0]) * 0.1, (corners[2] - corners[0]) * 0.1],
                normal: Vec3::Y,
            };
            truth.evaluate(&point, &mut values);
            let color = sampler.sample_channel(0, point.at, Footprint::NONE);
            (encoded(values[0]) - encoded(color)).abs().max_element()
        })
        .collect();
    differences.sort_by(f32::total_cmp);
    differences
}

#[test]
fn photographs_become_the_model_that_was_photographed() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (model, shoot) = (bottle(), path("shoot"));
    let taken = json(&[
        &"generate",
        &"photographs",
        &model,
        &"-o",
        &shoot,
        &"--count",
        &"12",
        &"--size",
        &"300x400",
        &"--samples",
        &"2",
        &"--standing",
    ]);
    assert_eq!((taken["photos"].as_u64(), taken["width"].as_u64()), (Some(12), Some(300)));
    assert_eq!(files(&shoot), ["images", "sparse", "transforms.json"]);
    assert_eq!(files(&shoot.join("images")).len(), 12);
    fails(1, &["exists already"], &[&"generate", &"photographs", &model, &"-o", &shoot, &"--count", &"2"]);
    // The same cameras as text, in a folder of their own.
    std::fs::create_dir(path("text")).unwrap();
    for name in ["cameras.txt", "images.txt"] {
        std::fs::copy(shoot.join("sparse/0").join(name), path("text").join(name)).unwrap();
    }
    let sources = [
        ("binary.fan", format!("photos={}", shoot.display())),
        ("text.fan", format!("photos={},images={}", path("text").display(), shoot.join("images").display())),
        ("json.fan", format!("photos={}", shoot.join("transforms.json").display())),
    ];
    for (name, source) in &sources {
        let asset = path(name);
        let sizes = ["--texels=400k", "--longest-edge=0"];
        let info = json(&[&"bake", &model, &"-o", &asset, &"--source", source, &sizes[0], &sizes[1]]);
        assert_eq!(info["source"], *source);
        assert_eq!((info["photos"].as_u64(), info["photos_used"].as_u64()), (Some(12), Some(12)));
        assert_eq!(info["gains"].as_array().unwrap().len(), 12);
        assert_eq!(info["channels"].as_array().unwrap().len(), 1);
        let unseen = info["unseen_share"].as_f64().unwrap();
        assert!((0.05..0.5).contains(&unseen), "{unseen}");
        let verified = json(&[&"verify", &asset]);
        assert_eq!(verified["ok"], true, "{verified:#}");
        // The bottle's own glow is not part of it.
        let materials = &Asset::open(&asset).unwrap().mesh().materials.clone();
        assert!(materials.iter().all(|m| m.emission == Vec3::ZERO && m.metallic == 0.0));
        // A fifth of the triangles is hidden behind others or below.
        let differences = differences(&asset);
        let [half, most] = [50, 70].map(|percent| differences[differences.len() * percent / 100]);
        assert!(half < 0.02 && most < 0.08, "{name}: {half} {most}");
    }
    assert_eq!(std::fs::read(path("binary.fan")).unwrap(), std::fs::read(path("text.fan")).unwrap());
    // Nothing of the scratch file stays, and little memory changes nothing.
    let source = &sources[0].1;
    let little = path("little.fan");
    let info = json(&[
        &"bake",
        &model,
        &"-o",
        &little,
        &"--source",
        source,
        &"--texels",
        &"400k",
        &"--longest-edge",
        &"0",
        &"--memory",
        &"4M",
    ]);
    assert!(info["scratch_bytes"].as_u64().unwrap() > 1 << 20, "{info:#}");
    assert_eq!(std::fs::read(&little).unwrap(), std::fs::read(path("binary.fan")).unwrap());
    assert_eq!(files(folder.path()).iter().filter(|name| !name.ends_with(".fan")).count(), 2);
    // The photographs' own density is that of their pixels; other sources know no photographs.
    let matched = json(&[&"bake", &model, &"-o", &path("match.fan"), &"--source", source, &"--match"]);
    assert!((50_000..2_000_000).contains(&matched["texels"].as_u64().unwrap()), "{matched:#}");
    let own = json(&[&"bake", &model, &"-o", &path("own.fan"), &"--texels", &"20k"]);
    assert!(own.get("photos").is_none() && own.get("gains").is_none());
}

#[test]
fn exposures_are_levelled_and_unseen_surface_is_coloured() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (model, shoot) = (bottle(), path("shoot"));
    succeeds(&[
        &"generate",
        &"photographs",
        &model,
        &"-o",
        &shoot,
        &"--count",
        &"9",
        &"--size",
        &"200x260",
        &"--samples",
        &"1",
        &"--lens",
        &"fisheye",
        &"--exposure",
        &"0.4",
        &"--standing",
    ]);
    let bake = |name: &str, options: &str| {
        let source = format!("photos={}{options}", shoot.display());
        json(&[&"bake", &model, &"-o", &path(name), &"--source", &source, &"--texels", &"100k"])
    };
    let gains = |info: &serde_json::Value| -> Vec<f64> {
        let gains = info["gains"].as_array().unwrap();
        gains.iter().map(|gain| gain[1].as_f64().unwrap()).collect()
    };
    let levelled = gains(&bake("level.fan", ""));
    // What was darkened by `generate` (in green: 1.4 to a sine) is lightened, up to a common factor.
    let products: Vec<f64> =
        levelled.iter().zip(0..).map(|(g, i)| g * 1.4_f64.powf((f64::from(i) * 2.4).sin())).collect();
    let mean = products.iter().sum::<f64>() / 9.0;
    assert!(products.iter().all(|p| (p / mean - 1.0).abs() < 0.05), "{products:?}");
    assert!(gains(&bake("raw.fan", ",exposure=off")).iter().all(|&gain| gain == 1.0));
    let source = format!("photos={},unseen=ff0000", shoot.display());
    let asset = path("red.fan");
    let output = succeeds(&[&"bake", &model, &"-o", &asset, &"--source", &source, &"--texels", &"100k"]);
    assert!(stderr(&output).contains("no photograph sees"), "{}", stderr(&output));
    let cache = PageCache::new(Arc::new(Asset::open(&asset).unwrap()), 64 << 20);
    let sampler = Sampler::of_cache(&cache, FilterOptions::default());
    let triangles = cache.asset().mesh().triangles.len();
    let red = (0..triangles as u32).filter(|&t| {
        let color = sampler.sample_channel(0, SurfacePoint::centroid(t), Footprint::NONE);
        color.x > 0.95 && color.y < 0.05
    });
    assert!(red.count() > triangles / 50);
}

#[test]
fn photographs_that_cannot_be_taken_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let take = |code: i32, words: &[&str], output: &Path, size: &str| {
        let memory = ["--memory", "256M"];
        let command: [&dyn AsRef<std::ffi::OsStr>; 9] = [
            &"generate",
            &"photographs",
            &bottle(),
            &"-o",
            &output,
            &"--size",
            &size,
            &memory[0],
            &memory[1],
        ];
        fails(code, words, &command);
        assert!(files(folder.path()).is_empty(), "{:?}", files(folder.path()));
    };
    let shoot = folder.path().join("shoot");
    take(2, &["both sides must be between 1 and 16384"], &shoot, "16385x4");
    take(1, &["a photograph of 16384 x 16384 pixels", "--memory"], &shoot, "16384x16384");
    take(2, &["files are written here"], Path::new("s3://bucket/shoot"), "4x4");
    assert!(!Path::new("s3:").exists());
    // A folder in the place of the file that is written last.
    std::fs::create_dir_all(shoot.join("transforms.json")).unwrap();
    let command: [&dyn AsRef<std::ffi::OsStr>; 6] =
        [&"generate", &"photographs", &bottle(), &"-o", &shoot, &"--force"];
    fails(1, &["transforms.json: it is a folder"], &command);
    assert_eq!(files(&shoot), ["transforms.json"]);
}

#[test]
fn photographs_that_cannot_be_used_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (model, asset) = (bottle(), folder.path().join("a.fan"));
    let bake = |code: i32, words: &[&str], source: &str| {
        fails(code, words, &[&"bake", &model, &"-o", &asset, &"--source", &source]);
        assert!(!asset.exists());
    };
    bake(2, &["photographs need a path"], "photos=");
    bake(2, &["photographs need a path"], "photos=a,unseen=blue");
    let empty = format!("photos={}", folder.path().display());
    bake(1, &["holds no cameras", "sparse/0"], &empty);
    write(folder.path(), "cameras.txt", "1 EUCM 10 10 1 1 5 5 1\n");
    write(folder.path(), "images.txt", "1 1 0 0 0 0 0 2 1 a.png\n\n");
    bake(1, &["cameras.txt: line 1", "'EUCM' is not supported"], &empty);
    write(folder.path(), "cameras.txt", "1 PINHOLE 10 10 9 9 5 5\n");
    bake(1, &["1 of 1 photograph is missing", "a.png", "images=FOLDER"], &empty);
    std::fs::create_dir(folder.path().join("images")).unwrap();
    write(&folder.path().join("images"), "a.png", "no picture");
    // A camera that looks away from the model does not even open its picture.
    bake(1, &["none of 1 photograph sees the model"], &empty);
}
