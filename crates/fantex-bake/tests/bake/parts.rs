//! Bakes in parts: merged, they are what one process writes; whatever is missing or wrong is named.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::{
    BakeFormat, BakeOptions, LookSource, NoProgress, SineSource, Source, bake, bake_part, plan_bake,
};
use fantex_base::Random;
use fantex_cover::{Cover, CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{Mesh, generate};
use fantex_store::{
    Asset, ByteSource, CreateOptions, FileSource, Plan, Recipe, WriteSummary, cover_level_count, merge_parts,
    merge_with_gaps,
};

use crate::common::{cleaned, cover};

const WAVE: SineSource = SineSource { k: 30.0 };

/// Bakes all parts of a plan, the last first.
fn parts(
    folder: &Path,
    planned: &Plan,
    mesh: &Mesh,
    source: &dyn Source,
    count: u32,
    options: &BakeOptions,
) -> Vec<PathBuf> {
    let bake = |number| {
        let path = folder.join(format!("{number}-of-{count}.part"));
        bake_part(mesh, planned, [number, count], source, &path, options, &NoProgress).unwrap();
        path
    };
    (1..=count).rev().map(bake).collect()
}

fn check_same(mesh: &Mesh, cover: &Cover, source: &dyn Source, format: BakeFormat, counts: &[u32]) {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let options = BakeOptions { format, ..BakeOptions::default() };
    bake(mesh, cover, source, &at("whole.fan"), &options, &NoProgress).unwrap();
    let whole = std::fs::read(at("whole.fan")).unwrap();
    plan_bake(mesh, cover, source, &at("plan.fan"), &options, &Recipe::default(), b"note").unwrap();
    let planned = Plan::open(&at("plan.fan")).unwrap();
    assert_eq!(planned.about, b"note");
    assert!(planned.cover == *cover && Asset::open(&at("whole.fan")).unwrap().cover() == cover);
    let options = BakeOptions { memory_bytes: 1 << 20, ..options };
    for &count in counts {
        let parts = parts(folder.path(), &planned, mesh, source, count, &options);
        let merged = at(&format!("merged-{count}.fan"));
        let create = CreateOptions::default();
        let written =
            merge_parts(&planned, &parts, Some((&merged, &create)), &|_, _| ControlFlow::Continue(()))
                .unwrap();
        assert!(std::fs::read(&merged).unwrap() == whole, "{count} parts");
        let read = std::cell::Cell::new(0);
        let length: u64 = parts.iter().map(|path| path.metadata().unwrap().len()).sum();
        let watch = |done, total| {
            assert!(read.replace(done) <= done && done <= total && total == length);
            ControlFlow::Continue(())
        };
        let checked = merge_parts(&planned, &parts, None, &watch).unwrap();
        assert!(read.get() > length / 2);
        assert_eq!(checked.clusters, written.clusters);
        check_gaps(&planned, &parts, &at(&format!("gaps-{count}.fan")), &whole, written);
    }
}

/// What a merge leaves out lies in the parts as it does in the asset, in long runs.
fn check_gaps(planned: &Plan, parts: &[PathBuf], path: &Path, whole: &[u8], written: WriteSummary) {
    let open = |path: &PathBuf| -> Arc<dyn ByteSource> { Arc::new(FileSource::open(path).unwrap()) };
    let sources: Vec<_> = parts.iter().map(open).collect();
    let go_on = |_, _| ControlFlow::Continue(());
    let (made, gaps) = merge_with_gaps(planned, &sources, path, &CreateOptions::default(), &go_on).unwrap();
    assert_eq!(made, written);
    let mut bytes = std::fs::read(path).unwrap();
    assert_eq!(bytes.len(), whole.len());
    let mut end = 0;
    for gap in &gaps {
        assert!(end <= gap.range.start && gap.range.start < gap.range.end, "{gap:?}");
        end = gap.range.end;
        let part = std::fs::read(&parts[gap.part]).unwrap();
        let (from, to) = (gap.offset as usize, gap.range.start as usize);
        let length = (gap.range.end - gap.range.start) as usize;
        assert!(bytes[to..to + length].iter().all(|&byte| byte == 0), "{gap:?}");
        bytes[to..to + length].copy_from_slice(&part[from..from + length]);
    }
    assert!(bytes == whole, "{} gaps", gaps.len());
    // Heads part the clusters of a part, at most one of each level.
    let levels = cover_level_count(&planned.cover) as usize;
    assert!(gaps.len() <= parts.len() * (levels + 1), "{} gaps", gaps.len());
}

#[test]
fn merged_parts_are_what_one_process_writes() {
    let mesh = cleaned(generate::icosphere(4));
    let small = cover(&mesh, 64, 1_000_000);
    check_same(&mesh, &small, &WAVE, BakeFormat::Bc7, &[1, 2, 3, 7, 40]);
    // More parts than tiles; some have none.
    let mesh = cleaned(generate::icosphere(1));
    let few = cover(&mesh, 64, 200_000);
    check_same(&mesh, &few, &WAVE, BakeFormat::Float, &[1, 5, 2 * few.groups.len() as u32]);
    // The angle of hard edges lies in the header.
    let budget = TexelBudget::Total(100_000);
    let options = CoverOptions { budget, hard_edges: Some(60.0), ..CoverOptions::default() };
    let cube = cleaned(generate::cube(3));
    check_same(&cube, &build_cover(&cube, &options).unwrap().0, &WAVE, BakeFormat::Bc1, &[3]);
    let bottle = fantex_test::bottle();
    let source = LookSource::of_model(&bottle).unwrap();
    check_same(&bottle, &cover(&bottle, 64, 500_000), &source, BakeFormat::Rgba8, &[4]);
}

/// Which shards are missing is found without asking for each: there may be four thousand millions.
#[test]
fn missing_shards_are_those_that_would_fill_the_gap() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mesh = cleaned(generate::icosphere(2));
    let tiles = cover(&mesh, 32, 60_000);
    let groups = tiles.groups.len() as u32;
    let options = BakeOptions::default();
    plan_bake(&mesh, &tiles, &WAVE, &at("plan.fan"), &options, &Recipe::default(), b"").unwrap();
    let planned = Plan::open(&at("plan.fan")).unwrap();
    for count in [1, 3, 7, groups, 3 * groups, u32::MAX] {
        let mut random = Random::of_seeds([count.into(), 0]);
        for _ in 0..10 {
            let number = 1 + random.below(count.into()) as u32;
            let kept = planned.shard(number, count).unwrap();
            bake_part(
                &mesh,
                &planned,
                [number, count],
                &WAVE,
                &at("a.part"),
                &BakeOptions { force: true, ..options.clone() },
                &NoProgress,
            )
            .unwrap();
            let merged = merge_parts(&planned, &[at("a.part")], None, &|_, _| ControlFlow::Continue(()));
            if kept.len() == groups as usize {
                merged.unwrap();
                continue;
            }
            let sentence = merged.unwrap_err().to_string();
            // What lies before the part is named first.
            let gap = if kept.is_empty() {
                0..groups
            } else if kept.start > 0 {
                0..kept.start
            } else {
                kept.end..groups
            };
            let names = |n: &u32| {
                let own = planned.shard(*n, count).unwrap();
                (!own.is_empty() && gap.start <= own.start && own.end <= gap.end)
                    .then(|| format!("{n}/{count}"))
            };
            if count < u32::MAX {
                let mut expected: Vec<String> = (1..=count).filter_map(|n| names(&n)).collect();
                if expected.len() > 8 {
                    expected.truncate(8);
                    expected.push("...".into());
                }
                let named = format!(
                    "tiles {} to {} is missing (shard {})",
                    gap.start,
                    gap.end - 1,
                    expected.join(", ")
                );
                assert!(sentence.contains(&named), "{sentence}, {named}");
            }
        }
    }
}

#[test]
fn parts_that_are_missing_wrong_or_damaged_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mesh = cleaned(generate::icosphere(3));
    let tiles = cover(&mesh, 64, 300_000);
    let options = BakeOptions::default();
    plan_bake(&mesh, &tiles, &WAVE, &at("plan.fan"), &options, &Recipe::default(), b"").unwrap();
    let planned = Plan::open(&at("plan.fan")).unwrap();
    let made = parts(folder.path(), &planned, &mesh, &WAVE, 4, &options);
    let create = CreateOptions::default();
    let refused = |parts: &[PathBuf], words: &str| {
        let error =
            merge_parts(&planned, parts, Some((&at("out.fan"), &create)), &|_, _| ControlFlow::Continue(()))
                .unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
        assert!(!at("out.fan").exists());
    };
    let without = |index: usize| [&made[..index], &made[index + 1..]].concat();
    refused(&without(0), "is missing (shard 4/4)");
    refused(&without(2), "is missing (shard 2/4)");
    refused(&[&made[..], &made[1..2]].concat(), "have the same tiles");
    refused(&[&without(0)[..], &[at("plan.fan")]].concat(), "plan.fan is no part of a bake");
    // Of another plan.
    let other = cover(&mesh, 64, 200_000);
    plan_bake(&mesh, &other, &WAVE, &at("other.fan"), &options, &Recipe::default(), b"").unwrap();
    let other = Plan::open(&at("other.fan")).unwrap();
    bake_part(&mesh, &other, [4, 4], &WAVE, &at("other.part"), &options, &NoProgress).unwrap();
    refused(&[&without(0)[..], &[at("other.part")]].concat(), "belongs to another plan");
    // Of the same tiles and another recipe.
    let mut marble = Recipe::default();
    marble.add_setting("the source", "marble");
    plan_bake(&mesh, &tiles, &WAVE, &at("marble.fan"), &options, &marble, b"").unwrap();
    let marble = Plan::open(&at("marble.fan")).unwrap();
    bake_part(&mesh, &marble, [4, 4], &WAVE, &at("marble.part"), &options, &NoProgress).unwrap();
    refused(&[&without(0)[..], &[at("marble.part")]].concat(), "marble.part belongs to another plan");
    // The same model with other channels, and another model.
    let bottle = fantex_test::bottle();
    let source = LookSource::of_model(&bottle).unwrap();
    for (mesh, source) in [(&bottle, &source as &dyn Source), (&cleaned(generate::torus(9, 9)), &WAVE)] {
        let refused = bake_part(mesh, &planned, [1, 4], source, &at("no.part"), &options, &NoProgress);
        assert!(refused.is_err() && !at("no.part").exists());
    }
    // Neither is an asset.
    for path in [&at("plan.fan"), &made[0]] {
        Asset::open(path).unwrap_err();
    }
    // Damage anywhere is found, and never more than a sentence.
    let whole = std::fs::read(&made[1]).unwrap();
    let mut older = made.clone();
    older[1] = at("older.part");
    std::fs::write(&older[1], [&b"FANPART1"[..], &whole[8..]].concat()).unwrap();
    refused(&older, "older.part is a part of version 1, and this program reads version 2: bake it anew");
    let mut random = Random::new(3);
    for round in 0..300 {
        let mut bytes = whole.clone();
        if round % 4 == 0 {
            bytes.truncate(random.below(whole.len() as u64) as usize);
        } else {
            let early = if round % 2 == 0 { 200 } else { whole.len() as u64 };
            bytes[random.below(early) as usize] ^= 1 << random.below(8);
        }
        let mut broken = made.clone();
        broken[1] = at("broken.part");
        std::fs::write(&broken[1], bytes).unwrap();
        merge_parts(&planned, &broken, None, &|_, _| ControlFlow::Continue(())).unwrap_err();
    }
    std::fs::write(at("broken.part"), [&whole[..], b"more"].concat()).unwrap();
    let mut longer = made.clone();
    longer[1] = at("broken.part");
    refused(&longer, "broken.part is damaged");
    let plan = std::fs::read(at("plan.fan")).unwrap();
    for _ in 0..300 {
        let mut bytes = plan.clone();
        bytes[random.below(plan.len() as u64) as usize] ^= 1 << random.below(8);
        std::fs::write(at("broken.fan"), bytes).unwrap();
        // A header's twin may stand in for it, and padding says nothing.
        if let Ok(read) = Plan::open(&at("broken.fan")) {
            assert!(read.is_of(&planned.mesh, &planned.channels));
        }
    }
    let ended = merge_parts(&planned, &made, Some((&at("out.fan"), &create)), &|_, _| ControlFlow::Break(()))
        .unwrap_err();
    assert_eq!(ended.kind(), fantex_base::ErrorKind::Cancelled);
    merge_parts(&planned, &made, Some((&at("out.fan"), &create)), &|_, _| ControlFlow::Continue(())).unwrap();
}
