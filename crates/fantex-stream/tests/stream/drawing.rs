//! What renderers are told of views and of means.

use fantex_mesh::WorldFromMesh;
use fantex_stream::StreamView;
use fantex_stream::drawing::mean_records;
use glam::{DMat3, DVec3, Vec3};

/// What `FanMesh` (three/src) sends for a `PerspectiveCamera(50, 4 / 3)` of three at (1.5, 2, 3) that looks at (0.1, -0.2, 0.3), with
/// 640 x 480 pixels.
const OF_THREE: [f64; 15] = [
    1.5,
    2.0,
    3.0,
    0.8877545314489295,
    2.7755575615628914e-17,
    -0.4603171644550004,
    -0.26978907156129855,
    0.8102431532279258,
    -0.520307495153933,
    0.37296883081295734,
    0.5860938769917902,
    0.7192970308535607,
    0.6217435442066648,
    0.4663076581549986,
    514.6816609222941,
];

#[test]
fn the_numbers_of_a_page_are_the_view_of_its_camera() {
    let space = WorldFromMesh { offset: DVec3::new(0.25, -0.5, 1.0), scale: 2.0 };
    let eye = DVec3::new(1.5, 2.0, 3.0);
    let back = (eye - DVec3::new(0.1, -0.2, 0.3)).normalize();
    let right = DVec3::Y.cross(back).normalize();
    let axes = DMat3::from_cols(right, back.cross(right), back);
    let expected = StreamView::in_world(&space, eye, axes, 50.0, [640, 480]);
    assert_eq!(expected.eye, Vec3::new(0.625, 1.25, 1.0));
    let view = StreamView::of_numbers(&space, &OF_THREE).unwrap();
    assert_eq!(view.eye, expected.eye);
    assert!(view.axes.abs_diff_eq(expected.axes, 1e-6), "{} {}", view.axes, expected.axes);
    for (ours, own) in [
        (view.half_extent[0], expected.half_extent[0]),
        (view.half_extent[1], expected.half_extent[1]),
        (view.focal_pixels, expected.focal_pixels),
    ] {
        assert!((ours / own - 1.0).abs() < 1e-6, "{ours} {own}");
    }
    assert_eq!(StreamView::of_numbers(&space, &OF_THREE[..14]), None);
    assert_eq!(StreamView::of_numbers(&space, &[]), None);
}

#[test]
fn means_beyond_half_floats_are_their_greatest() {
    let mean = |channel: usize, group: u32| [1e5, -1e9, 65_504.0, 0.25 * (channel as f32 + group as f32)];
    let records = mean_records(2, 2, mean);
    let numbers: Vec<[f32; 4]> = records.iter().map(|record| record.map(|number| number.to_f32())).collect();
    let last = numbers.iter().map(|record| record[3]).collect::<Vec<_>>();
    assert_eq!(last, [0.0, 0.25, 0.25, 0.5], "groups, then channels");
    assert!(numbers.iter().all(|record| record[..3] == [65_504.0, -65_504.0, 65_504.0]), "{numbers:?}");
}
