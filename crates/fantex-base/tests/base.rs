//! Tests of the crate `fantex-base` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::error::Error as _;
use std::io;
use std::path::Path;

use fantex_base::files::write_whole;
use fantex_base::random::nth_random;
use fantex_base::srgb::*;
use fantex_base::{
    Aabb, Error, ErrorKind, Place, Random, ReadLimits, ReadOptions, UnionFind, counted, grouped, input,
};
use glam::{Vec2, Vec3};

#[test]
fn context_is_put_before_the_sentence() {
    let error = Error::malformed("expected 3 numbers, found 2").at(Place::Line(7)).in_file("a.ply");
    let error = error.context("cannot bake");
    assert_eq!(error.to_string(), "cannot bake: a.ply: line 7: expected 3 numbers, found 2");
    assert_eq!(error.path(), Some(Path::new("a.ply")));
    assert_eq!(error.place(), Some(&Place::Line(7)));
}

#[test]
fn the_innermost_file_and_place_are_kept() {
    let error = Error::malformed("no such column").at(Place::Byte(3)).in_file("inner.mtl");
    let error = error.at(Place::Line(2)).in_file("outer.obj");
    assert_eq!(error.path(), Some(Path::new("inner.mtl")));
    assert_eq!(error.place(), Some(&Place::Byte(3)));
}

#[test]
fn what_is_left_of_the_work_is_said_last() {
    let error = Error::new(ErrorKind::Io, "cannot write a.fan");
    assert_eq!(error.remains(), None);
    let error = error.leaving("a copy is in b.fan").context("cannot bake");
    assert_eq!(error.to_string(), "cannot bake: cannot write a.fan; a copy is in b.fan");
    assert_eq!((error.kind(), error.remains()), (ErrorKind::Io, Some("a copy is in b.fan")));
}

#[test]
fn files_of_a_folder_that_nobody_knows_have_other_names() {
    for (file, name) in [(".tmp-1/a.fan", "out/a.fan"), (".tmp-1", "out"), ("b/c.fan", "b/c.fan")] {
        let error = Error::writing(file, io::Error::from(io::ErrorKind::StorageFull));
        let error = error.renamed(Path::new(".tmp-1"), Path::new("out"));
        assert!(error.to_string().starts_with(&format!("cannot write {name}: ")), "{error}");
        assert_eq!(error.path().map(Path::as_os_str), Some(name.as_ref()));
    }
}

#[test]
fn a_missing_file_is_not_found() {
    let error = Error::reading("none.obj", io::Error::from(io::ErrorKind::NotFound));
    assert_eq!(error.kind(), ErrorKind::NotFound);
    assert!(error.to_string().starts_with("cannot read none.obj: "));
    assert!(error.source().is_some());
}

#[test]
fn an_error_is_one_pointer() {
    assert_eq!(size_of::<Error>(), size_of::<usize>());
}

#[test]
fn nouns_follow_their_counts() {
    let text = |count: u64, noun| counted(count, noun).to_string();
    assert_eq!(text(0, "triangle"), "0 triangles");
    assert_eq!(text(1, "index"), "1 index");
    assert_eq!(text(2, "index"), "2 indices");
    assert_eq!(text(2, "patch"), "2 patches");
    assert_eq!(text(7, "box"), "7 boxes");
}

#[test]
fn digits_stand_in_groups_of_three() {
    assert_eq!(grouped(7, ' '), "7");
    assert_eq!(grouped(69_451, ' '), "69 451");
    assert_eq!(grouped(1_234_567, ','), "1,234,567");
}

#[test]
fn numbers_are_those_of_the_reference_implementation() {
    // Sebastiano Vigna's splitmix64.c with the state 1234567.
    let mut random = Random::new(1_234_567);
    let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
    assert_eq!([(); 3].map(|()| random.next_u64()), expected);
    assert_eq!([0, 1, 2].map(|index| nth_random(1_234_567, index)), expected);
}

#[test]
fn units_and_limits_hold() {
    let mut random = Random::new(5);
    let mut sum = 0.0;
    for _ in 0..10_000 {
        let unit = random.unit();
        assert!((0.0..1.0).contains(&unit));
        sum += unit;
        assert!(random.below(7) < 7);
    }
    assert!((sum / 10_000.0 - 0.5).abs() < 0.02);
    assert!(!random.chance(0.0));
    assert!(random.chance(1.0));
}

#[test]
fn a_box_holds_its_points() {
    let points = [Vec3::new(1.0, -2.0, 0.5), Vec3::new(-1.0, 3.0, 0.25), Vec3::ZERO];
    let around = Aabb::of_points(points);
    assert!(points.iter().all(|&p| around.contains(p)));
    assert_eq!(around.size(), Vec3::new(2.0, 5.0, 0.5));
    assert_eq!(around.center(), Vec3::new(0.0, 0.5, 0.25));
    assert!(Aabb::<Vec3>::EMPTY.is_empty());
    assert_eq!(Aabb::EMPTY.union(around), around);
}

#[test]
fn boxes_that_touch_overlap() {
    let a = Aabb { min: Vec2::ZERO, max: Vec2::ONE };
    let b = Aabb { min: Vec2::ONE, max: Vec2::splat(2.0) };
    assert!(a.overlaps(&b) && b.overlaps(&a));
    assert!(!a.overlaps(&Aabb { min: Vec2::splat(1.5), max: Vec2::splat(2.0) }));
}

#[test]
fn bytes_survive_decoding_and_encoding() {
    for code in 0..=255_u8 {
        assert_eq!(srgb8_from_linear(linear_from_srgb8_table()[usize::from(code)]), code);
    }
    for code in 0..=65535_u16 {
        assert_eq!(srgb16_from_linear(linear_from_srgb16_table()[usize::from(code)]), code);
    }
}

#[test]
fn encoder_equals_the_rounded_formula() {
    for i in 0..2_000_000_u32 {
        let linear = i as f32 / 1_999_999.0;
        let exact = srgb_from_linear(linear) * 255.0;
        let code = f32::from(srgb8_from_linear(linear));
        assert!((exact - code).abs() <= 0.5 + 2e-4, "{linear} gave {code}, the curve says {exact}");
    }
}

#[test]
fn encoder_takes_any_float() {
    assert_eq!(srgb8_from_linear(f32::NAN), 0);
    assert_eq!(srgb8_from_linear(-1.0), 0);
    assert_eq!(srgb8_from_linear(f32::INFINITY), 255);
    assert_eq!(srgb8_from_linear(f32::MIN_POSITIVE), 0);
    assert_eq!(unorm8(f32::NAN), 0);
    assert_eq!(unorm16(f32::NEG_INFINITY), 0);
}

#[test]
fn curve_and_inverse_agree() {
    for i in -100..=200 {
        let encoded = i as f32 / 100.0;
        assert!((srgb_from_linear(linear_from_srgb(encoded)) - encoded).abs() < 2e-6);
    }
}

#[test]
fn sets_are_named_by_their_smallest_element() {
    let mut sets = UnionFind::new(6);
    assert!(sets.union(5, 3));
    assert!(sets.union(3, 1));
    assert!(!sets.union(1, 5));
    assert_eq!([0, 1, 2, 3, 4, 5].map(|e| sets.find(e)), [0, 1, 2, 1, 4, 1]);
    let mut numbers = vec![9];
    assert_eq!(sets.number(&mut numbers), 4);
    assert_eq!(numbers, [0, 1, 2, 1, 3, 1]);
}

#[test]
fn sets_are_numbered_in_the_order_of_their_smallest_elements() {
    let mut random = Random::new(3);
    for elements in [0, 1, 2, 30, 1000] {
        let mut sets = UnionFind::new(elements);
        for _ in 0..elements * 2 / 3 {
            let [a, b] = [(); 2].map(|()| random.below(elements as u64) as u32);
            sets.union(a, b);
        }
        let mut numbers = Vec::new();
        let count = sets.number(&mut numbers);
        let firsts: Vec<u32> = (0..elements as u32).filter(|&e| sets.find(e) == e).collect();
        assert_eq!(firsts.len(), count);
        for e in 0..elements as u32 {
            assert_eq!(firsts[numbers[e as usize] as usize], sets.find(e));
        }
    }
}

#[test]
fn limits_hold_for_the_work_that_is_done_within_them() {
    let limits = |memory_bytes, allow_outside| {
        ReadLimits::new(ReadOptions { memory_bytes, allow_outside, ..ReadOptions::default() })
    };
    let (small, large) = (limits(100, false), limits(1000, true));
    let outside = || input::check_inside(Path::new("folder/a.obj"), Path::new("../b.mtl"));
    let held = large.run(|| {
        // Within others, for as long as the work takes, even if it panics.
        assert!(small.run(|| input::reserve("a", 101)).is_err());
        assert!(small.run(outside).is_err());
        assert!(std::panic::catch_unwind(|| small.run(|| panic!("on purpose"))).is_err());
        outside().unwrap();
        input::reserve("a", 900).unwrap()
    });
    assert_eq!((small.memory_left(), large.memory_left()), (100, 100));
    let other = large.clone();
    std::thread::spawn(move || assert!(other.run(|| input::reserve("a", 101)).is_err())).join().unwrap();
    // Gone elsewhere, it is still given back to where it was taken.
    small.run(|| drop(held));
    assert_eq!((small.memory_left(), large.memory_left()), (100, 1000));
}

#[test]
fn what_is_read_within_limits_is_protected_by_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    std::fs::write(&path, "text").unwrap();
    let protecting = ReadLimits::new(ReadOptions { protect_inputs: true, ..ReadOptions::default() });
    assert_eq!(protecting.run(|| input::read_text(&path)).unwrap(), "text");
    input::check_output(&path).unwrap();
    let refused = protecting.run(|| write_whole(&path, true, |_| Ok(())));
    assert_eq!(refused.is_err(), cfg!(unix));
}

#[test]
fn files_that_are_opened_are_noted_where_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    ["a", "b", "c"].iter().for_each(|name| std::fs::write(at(name), "text").unwrap());
    let plain = ReadLimits::new(ReadOptions::default());
    let noting = plain.noting_files();
    noting.run(|| {
        input::read_text(&at("b")).unwrap();
        let limits = ReadLimits::current();
        std::thread::spawn({
            let path = at("a");
            move || limits.run(|| input::read(&path).unwrap())
        })
        .join()
        .unwrap();
        input::open(&at("none")).unwrap_err();
    });
    plain.run(|| input::read(&at("c"))).unwrap();
    assert_eq!(noting.noted_files(), [at("a"), at("b")]);
    // The budget is one.
    let _held = noting.run(|| input::hold(10));
    assert_eq!(plain.memory_left(), noting.memory_left());
    assert!(plain.noted_files().is_empty());
}
