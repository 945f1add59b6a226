//! Damaged texels that a strict bake must not take coarser ones for.

#![cfg(feature = "export")]
#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use fantex::export::ExportOptions;
use fantex::{Asset, BakeFormat, Baker, ErrorKind, Mesh, Source};
use fantex_mesh::generate::icosphere;
use glam::Vec3;

/// The baker's word counts as much as the options'.
#[test]
fn strict_bakers_write_no_models_of_damaged_assets() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = Mesh::from_model(icosphere(3), "ball").unwrap();
    let detailed = folder.path().join("detailed.fan");
    let noise = |p: Vec3| (p * 300.0).map(|x| 0.5 + 0.5 * x.sin()).extend(1.0);
    let baker = Baker::new(&mesh).texels(200_000).format(BakeFormat::Float);
    baker.source(Source::function(|point| noise(point.position))).write(&detailed).unwrap();
    let mut content = std::fs::read(&detailed).unwrap();
    let middle = content.len() / 2;
    content[middle..][..64].fill(0x55);
    std::fs::write(&detailed, content).unwrap();
    let asset = Asset::open(&detailed).unwrap();
    let model = folder.path().join("ball.glb");
    for (is_baker, is_option) in [(true, false), (false, true)] {
        let options = ExportOptions { strict: is_option, ..ExportOptions::default() };
        let baker = Baker::new(&mesh).texels(50_000).source(Source::asset(&asset, None)).strict(is_baker);
        let error = baker.write_model(&model, &options).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Damaged, "{error}");
        assert!(!model.exists());
    }
    let baker = Baker::new(&mesh).texels(50_000).source(Source::asset(&asset, None));
    assert!(baker.write_model(&model, &ExportOptions::default()).unwrap().summary.damage.pages > 0);
}
