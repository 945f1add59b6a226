//! Budgets, densities, modes, threads, options and hostile meshes.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use fantex_base::{ErrorKind, ReadLimits, ReadOptions};
use fantex_cover::{Cover, CoverOptions, GroupKind, MAX_EXTENT, TexelBudget, build_cover, build_cover_while};
use fantex_mesh::{CleanOptions, Mesh, Model, WorldFromMesh, clean, generate};
use glam::{DVec3, Vec3};

use crate::common::{
    cleaned, covered, data_folder, fans_of, generated, landscape, leaf, loaded, model, options, raw, saddle,
    spike,
};

fn built(mesh: &Mesh, tile: u32, budget: TexelBudget) -> Cover {
    build_cover(mesh, &options(tile, budget)).unwrap().0
}

#[test]
fn a_total_is_kept_and_used_up() {
    let mut meshes = vec![("landscape", landscape(8_000))];
    if let Some(folder) = data_folder() {
        meshes.push(("spot", loaded(&folder, "meshes/spot/spot_triangulated.obj")));
        meshes.push(("bottle", loaded(&folder, "meshes/WaterBottle/WaterBottle.gltf")));
    }
    for (name, mesh) in meshes {
        for tile in [0, 64, 128] {
            for total in [300_000, 1 << 20, 5_590_000, 64 << 20] {
                let cover = built(&mesh, tile, TexelBudget::Total(total));
                let share = cover.stored_texels(&mesh) as f64 / total as f64;
                assert!(share <= 1.0 && share > 0.98, "{name}, tile {tile}, {total}: {share}");
            }
        }
    }
}

/// Margins count, which densities leave out.
#[test]
fn densities_shrink_alike_until_no_more_than_the_most_texels_are_stored() {
    let mesh = landscape(8_000);
    let densities: Vec<f32> = (0..mesh.triangles.len()).map(|t| 400.0 + (t % 7) as f32).collect();
    let options = options(1024, TexelBudget::PerTriangle(densities));
    let free = build_cover(&mesh, &options).unwrap().0;
    let texels = free.stored_texels(&mesh);
    for most in [texels + 1, texels, texels * 9 / 10, texels / 3] {
        let cover =
            build_cover(&mesh, &CoverOptions { most_texels: Some(most), ..options.clone() }).unwrap().0;
        let stored = cover.stored_texels(&mesh);
        if most < texels {
            assert!(stored <= most && stored as f64 > 0.98 * most as f64, "{stored} of {most}");
        } else {
            assert_eq!(cover, free);
        }
    }
}

/// Small groups are laid flat across creases on large meshes, too: a town loses hardly more than a street of the same houses.
#[test]
fn many_boxes_are_covered_as_well_as_few() {
    let boxes = |count: u32| {
        let (mut boxes, cube) = (Model::default(), generate::cube(1));
        for number in 0..count {
            let first = boxes.positions.len() as u32;
            boxes.triangles.extend(cube.triangles.iter().map(|t| t.map(|v| v + first)));
            let place = 4.0 * DVec3::new(f64::from(number % 50), f64::from(number / 50), 0.0);
            let size = DVec3::new(1.0, 0.7, 0.5 + f64::from(number % 7) / 5.0);
            boxes.positions.extend(cube.positions.iter().map(|&p| p * size + place));
        }
        cleaned(boxes)
    };
    let [few, many] = [200, 2_600].map(|count| {
        let mesh = boxes(count);
        let (cover, stats) =
            build_cover(&mesh, &options(1024, TexelBudget::Total(333 * u64::from(count)))).unwrap();
        (cover.groups.len() as f64 / f64::from(count), stats.loss_db)
    });
    assert!(many.1 < few.1 + 1.5, "{} dB, {} dB of few", many.1, few.1);
    assert!(many.0 < 5.0, "{} tiles per box, {} of few", many.0, few.0);
}

/// Where single fans are longer than tiles may be, those beside them share their tiles all the same.
#[test]
fn long_strips_side_by_side_share_tiles() {
    let (strips, mut plate) = (100, Model::default());
    for row in 0..=strips {
        let y = 2.0 * f64::from(row) / f64::from(strips) - 1.0;
        plate.positions.extend([-1.0, 1.0].map(|x| DVec3::new(x, y, 0.0)));
    }
    for first in (0..strips).map(|row| 2 * row) {
        plate.triangles.extend([[first, first + 1, first + 3], [first, first + 3, first + 2]]);
    }
    let mesh = cleaned(plate);
    for millions in [1, 4, 16] {
        let options = options(1024, TexelBudget::Total(millions << 20));
        let (cover, stats) = build_cover(&mesh, &options).unwrap();
        let texels = |group: &fantex_cover::Group| group.extent[0] * group.extent[1];
        assert!(
            cover.groups.len() as u64 <= 3 * millions,
            "{} tiles of {millions} M texels",
            cover.groups.len()
        );
        assert!(cover.groups.iter().all(|group| texels(group) < 1_200_000));
        assert!(stats.loss_db < 1.0, "{millions} M texels: {} dB", stats.loss_db);
    }
}

/// Teeth that are longer than a tile would each be a piece by itself.
#[test]
fn a_comb_of_long_teeth_is_not_torn() {
    let mut comb = Model::default();
    let mut quad = |[x0, x1]: [f64; 2], [y0, y1]: [f64; 2]| {
        let first = comb.positions.len() as u32;
        comb.positions.extend([[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|[x, y]| DVec3::new(x, y, 0.0)));
        comb.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|v| v + first)));
    };
    for tooth in 0..1000 {
        let [x, middle, next] = [0.0, 0.9, 1.0].map(|share| 0.01 * (f64::from(tooth) + share));
        quad([x, middle], [-1.0, 0.0]);
        quad([middle, next], [-1.0, 0.0]);
        quad([x, middle], [0.0, 20.0]);
    }
    let mesh = cleaned(comb);
    for texels in [300_000, 1_000_000, 4_000_000] {
        let losses = [1024, 65_536]
            .map(|tile| build_cover(&mesh, &options(tile, TexelBudget::Total(texels))).unwrap().1.loss_db);
        assert!(losses[0] < losses[1] + 2.0, "{texels} texels: {losses:?} dB");
    }
}

/// Where tiles are alike they all grow at once, and a step may be wide; but no tile grows beyond the budget.
#[test]
fn alike_tiles_take_what_fits() {
    for total in [10_000, 100_000, 1 << 20, 16 << 20] {
        let mesh = cleaned(generate::cube(1));
        let cover = built(&mesh, 0, TexelBudget::Total(total));
        let shorter = cover.groups.iter().flat_map(|g| g.extent).min().unwrap();
        let step = if shorter >= 1000 { 32.0 } else { 4.0 };
        let next = f64::from(shorter).mul_add(1.0, step) / f64::from(shorter);
        let share = cover.stored_texels(&mesh) as f64 / total as f64;
        assert!(share <= 1.0 && share * next * next > 0.98, "{total}: {share}");
    }
}

#[test]
fn a_budget_below_the_smallest_tiles_gives_the_smallest_tiles() {
    let mesh = cleaned(generate::icosphere(2));
    let cover = built(&mesh, 0, TexelBudget::Total(1));
    assert!(cover.groups.iter().all(|g| g.extent == [4, 4]));
}

/// Rounding a tile's sides costs at most 6 % of the nominal density, and gives at most four texels per side. Groups get more, because what
/// they are seen at a slant is made up for, and not the same along both sides; unfolded fans, which are spread out, may get less.
#[test]
fn densities_stay_near_the_nominal() {
    for (name, mesh) in generated() {
        for (tile, density) in [(0, 40.0), (0, 700.0), (64, 60.0), (256, 200.0)] {
            let cover = built(&mesh, tile, TexelBudget::Density(density));
            assert_eq!(cover.density, density as f32);
            for group in cover.groups {
                let sides = group.uv_scale.to_array().into_iter().zip(group.extent);
                let ratios: Vec<(f64, f64)> = sides
                    .map(|(scale, extent)| {
                        let texels = f64::from(extent);
                        let most = if extent == 4 { 6.0 } else { (texels - 1.0) / (texels - 5.0) };
                        let most = if extent > 1000 { 1.02 } else { most };
                        (f64::from(scale) * texels / density, most + 1e-3)
                    })
                    .collect();
                if tile == 0 {
                    let good = ratios.iter().all(|&(ratio, most)| ratio > 0.94 - 1e-4 && ratio < most);
                    assert!(good, "{name}: {ratios:?}");
                } else {
                    let both = (ratios[0].0 * ratios[1].0).sqrt();
                    let most = (ratios[0].1 * ratios[1].1).sqrt();
                    let least = if group.kind == GroupKind::Unfolded { 0.7 } else { 1.0 };
                    let good = both > (0.94 - 1e-4) * least && both < 4.0 * most;
                    assert!(good, "{name}, tile {tile}: {:?} {ratios:?}", group.kind);
                }
            }
        }
    }
}

/// What asks for more texels than its surroundings gets them, and the surroundings do not pay for it: tiles end there, and one that
/// holds both has the error of both at their own densities.
#[test]
fn dense_spots_keep_their_density() {
    let mesh = cleaned(generate::icosphere(5));
    let height =
        |t: usize| mesh.triangle_positions(t).map(|p| p.z / p.length()).into_iter().sum::<f32>() / 3.0;
    let asked: Vec<f32> =
        (0..mesh.triangles.len()).map(|t| if height(t) > 0.9 { 360.0 } else { 60.0 }).collect();
    let texels_asked: f64 =
        asked.iter().zip(0..).map(|(&d, t)| mesh.triangle_area(t) * f64::from(d).powi(2)).sum();
    let cover = built(&mesh, 1024, TexelBudget::PerTriangle(asked.clone()));
    for (triangle, &asked) in asked.iter().enumerate() {
        for group in cover.corner_groups[triangle].map(|g| &cover.groups[g as usize]) {
            let texels = group.uv_scale.to_array().into_iter().zip(group.extent);
            let squared: f32 = texels.map(|(scale, extent)| scale * extent as f32).product();
            assert!(squared.sqrt() > 0.85 * asked, "triangle {triangle}: {} of {asked}", squared.sqrt());
        }
    }
    let evenly = built(&mesh, 1024, TexelBudget::Density(100.0));
    let overhead = evenly.stored_texels(&mesh) as f64 / (mesh.area() * 100.0 * 100.0);
    let stored = cover.stored_texels(&mesh) as f64 / texels_asked;
    assert!(stored < 1.25 * overhead, "{stored}, evenly {overhead}");
}

#[test]
fn every_triangle_gets_its_density_in_single_fans() {
    let mesh = landscape(3_000);
    let field: Vec<f32> = (0..mesh.triangles.len()).map(|t| 20.0 * (1.0 + (t * 7 % 13) as f32)).collect();
    let cover = built(&mesh, 0, TexelBudget::PerTriangle(field.clone()));
    for (groups, density) in cover.corner_groups.iter().zip(field) {
        for group in groups.map(|g| &cover.groups[g as usize]) {
            for k in 0..2 {
                assert!(group.uv_scale[k] * group.extent[k] as f32 > 0.939 * density);
            }
        }
    }
}

#[test]
fn one_fan_per_tile_is_the_thesis() {
    let mut meshes = generated();
    if let Some(folder) = data_folder() {
        meshes.push(("chair", loaded(&folder, "meshes/broken/chair_model.obj")));
        meshes.push(("bunny", loaded(&folder, "meshes/broken/bunny_nonmanifold.ply")));
    }
    for (name, mesh) in meshes {
        let (cover, stats) = build_cover(&mesh, &options(0, TexelBudget::Total(1 << 20))).unwrap();
        let fans = fans_of(&mesh);
        let mut pairs: Vec<(u32, u32)> = (0..mesh.triangles.len())
            .flat_map(|t| (0..3).map(move |k| (t, k)))
            .map(|(t, k)| (fans.of_corner(3 * t + k), cover.corner_groups[t][k]))
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        // A tile for every fan.
        let mut groups: Vec<u32> = pairs.iter().map(|p| p.1).collect();
        groups.sort_unstable();
        assert!(groups.windows(2).all(|w| w[0] != w[1]) && groups.len() == cover.groups.len(), "{name}");
        assert!(pairs.windows(2).all(|w| w[0].0 != w[1].0), "{name}");
        let unfolded = cover.groups.iter().filter(|g| g.kind == GroupKind::Unfolded).count() as u64;
        assert_eq!(unfolded, stats.fans.unfolded, "{name}");
    }
}

#[test]
fn groups_are_fewer_and_denser_than_fans() {
    let mesh = cleaned(generate::icosphere(5));
    let [thesis, grouped] =
        [0, 64].map(|tile| build_cover(&mesh, &options(tile, TexelBudget::Total(1 << 20))).unwrap());
    assert!(grouped.0.groups.len() * 4 < thesis.0.groups.len());
    assert!(grouped.1.density_share > 1.2 * thesis.1.density_share, "{:?} {:?}", grouped.1, thesis.1);
    assert!(grouped.1.lookups_per_sample < thesis.1.lookups_per_sample);
    let longest = grouped.0.groups.iter().flat_map(|g| g.extent).max().unwrap();
    assert!(longest <= 100, "{longest}");
}

#[test]
fn covers_do_not_depend_on_threads() {
    let mut meshes =
        vec![("landscape", landscape(30_000)), ("sphere", cleaned(generate::uv_sphere(300, 60)))];
    if let Some(folder) = data_folder() {
        meshes.push(("chair", loaded(&folder, "meshes/broken/chair_model.obj")));
    }
    for (name, mesh) in meshes {
        for tile in [0, 128] {
            let [one, two, four] = [1, 2, 4].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| built(&mesh, tile, TexelBudget::Total(4 << 20)))
            });
            assert!(one == two && one == four, "{name}, tile {tile}");
        }
    }
}

#[test]
fn a_spike_is_unfolded() {
    let mesh = spike(16, 25.0);
    let (cover, stats) = covered("spike", &mesh, &options(128, TexelBudget::Total(1 << 18)));
    assert!(stats.fans.unfolded >= 1, "{:?}", stats.fans);
    let tip = (0..mesh.positions.len())
        .max_by(|&a, &b| mesh.positions[a].y.total_cmp(&mesh.positions[b].y))
        .unwrap();
    let at_tip = |t: usize| mesh.triangles[t].iter().position(|&v| v as usize == tip);
    for (t, groups) in cover.corner_groups.iter().enumerate() {
        if let Some(k) = at_tip(t) {
            assert_eq!(cover.groups[groups[k] as usize].kind, GroupKind::Unfolded);
        }
    }
}

#[test]
fn a_fan_that_folds_is_unfolded_and_counted() {
    // Angles sum up to far more than a full turn, and no direction sees all triangles.
    for (n, height) in [(6, 1.0), (10, 1.2), (24, 2.0)] {
        let (_, stats) = covered("saddle", &saddle(n, height, 1.4), &options(0, TexelBudget::Total(1 << 16)));
        assert_eq!(stats.fans.folding, 1, "{:?}", stats.fans);
        assert!(stats.fans.unfolded >= 1);
    }
}

#[test]
fn twins_have_fans_of_their_own() {
    let mesh = cleaned(model(vec![DVec3::X, DVec3::Y, DVec3::Z], vec![[0, 1, 2], [0, 2, 1]]));
    for tile in [0, 64] {
        let (cover, stats) = covered("twins", &mesh, &options(tile, TexelBudget::Total(10_000)));
        assert_eq!((stats.fans.total, stats.fans.folding), (6, 0));
        // Front and back share no tile.
        assert!(cover.corner_groups[0].iter().all(|g| !cover.corner_groups[1].contains(g)));
    }
}

/// Both sides of a sheet are grouped as the sheet alone is: twice as many tiles, not one for every triangle.
#[test]
fn both_sides_of_a_leaf_are_grouped() {
    let (_, front) = covered("grid", &cleaned(generate::grid(8)), &options(64, TexelBudget::Total(10_000)));
    let (cover, both) = covered("leaf", &leaf(), &options(64, TexelBudget::Total(20_000)));
    assert_eq!(both.fans.total, 2 * front.fans.total);
    assert!(both.groups <= 2 * front.groups + 4, "{} {}", both.groups, front.groups);
    let triangles = cover.corner_groups.len() / 2;
    for t in 0..triangles {
        let back = cover.corner_groups[t + triangles];
        assert!(cover.corner_groups[t].iter().all(|g| !back.contains(g)), "front and back share no tile");
    }
}

#[test]
fn bad_options_are_refused_with_what_was_given() {
    let mesh = cleaned(generate::cube(1));
    let refused = |options: CoverOptions, what: &str| {
        let error = build_cover(&mesh, &options).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        assert!(error.to_string().contains(what), "{error}");
    };
    let with = |budget| CoverOptions { budget, ..CoverOptions::default() };
    for delta in [0.0, -0.1, 0.34, f32::INFINITY, f32::NAN] {
        refused(CoverOptions { delta, ..CoverOptions::default() }, &format!("at most 1/3, got {delta}"));
    }
    refused(with(TexelBudget::Total(0)), "positive and finite, got 0");
    // Neither 1e-60 nor 1e60 is a number of single precision, in which densities are kept.
    for given in [0.0, -3.0, f64::INFINITY, 1e-60, 1e60, f64::NAN] {
        refused(with(TexelBudget::Density(given)), &format!("positive and finite, got {given}"));
    }
    let mut field = vec![3.0; 12];
    field[7] = -1.0;
    refused(with(TexelBudget::PerTriangle(field)), "positive and finite, got -1");
    refused(with(TexelBudget::PerTriangle(vec![1.0; 11])), "has 11 values, expected one for each of the 12");
    let nothing = build_cover(&Mesh::default(), &CoverOptions::default()).unwrap_err();
    assert!(nothing.to_string().contains("no triangles"), "{nothing}");
}

#[test]
fn meshes_that_take_more_memory_than_is_allowed_are_refused() {
    let mesh = cleaned(generate::icosphere(5));
    let with = |memory_bytes: u64| {
        let limits = ReadLimits::new(ReadOptions { memory_bytes, ..ReadOptions::default() });
        limits.run(|| build_cover(&mesh, &CoverOptions::default()))
    };
    let error = with(1 << 20).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::TooLarge);
    let message = error.to_string();
    assert!(
        message.contains("a mesh of 20480 triangles and its cover would take 3 MiB of memory, 1 MiB is left"),
        "{message}"
    );
    with(4 << 20).unwrap();
}

/// Wherever it is: between the ways to cut, while patches are joined and unrolled, while tiles are sized.
#[test]
fn a_cover_that_is_not_wanted_any_more_ends() {
    let mesh = cleaned(generate::cube(2));
    for (tile, least_questions) in [(0, 2), (1024, 30)] {
        let options = options(tile, TexelBudget::Total(10_000));
        let questions = AtomicUsize::new(0);
        // A single no is enough.
        let ends_at = |last: usize| {
            questions.store(0, Relaxed);
            build_cover_while(&mesh, &options, &|_| questions.fetch_add(1, Relaxed) != last)
        };
        let (cover, _) = ends_at(usize::MAX).unwrap();
        assert_eq!(cover.groups, build_cover(&mesh, &options).unwrap().0.groups);
        let all = questions.load(Relaxed);
        assert!(all >= least_questions, "{all} questions, tile {tile}");
        for last in (0..all).step_by(all.div_ceil(10)).chain([all - 1]) {
            let error = ends_at(last).unwrap_err();
            assert!(error.is_cancelled(), "{error}");
            let more = questions.load(Relaxed) - last;
            assert!(more < 100, "{more} questions after number {last}, tile {tile}");
        }
    }
}

#[test]
fn a_cover_tells_how_far_it_is() {
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for (name, mesh) in [("landscape", landscape(6_000)), ("cube", cleaned(generate::cube(16)))] {
        for tile in [0, 1024] {
            let told = Mutex::new(vec![0.0]);
            let hear = |share| {
                told.lock().unwrap().push(share);
                true
            };
            let options = options(tile, TexelBudget::Total(1 << 20));
            one_thread.install(|| build_cover_while(&mesh, &options, &hear)).unwrap();
            let told = told.into_inner().unwrap();
            let steps: Vec<f32> = told.windows(2).map(|pair| pair[1] - pair[0]).collect();
            assert!(steps.iter().all(|&step| step >= 0.0), "{name}, tile {tile}: {told:?}");
            assert_eq!(told[told.len() - 1], 1.0, "{name}, tile {tile}");
            // Nowhere more than half of the time at once.
            let longest = steps.iter().copied().fold(0.0, f32::max);
            let several = steps.iter().filter(|&&step| step > 0.0).count();
            assert!(longest < 0.5 && several > 4, "{name}, tile {tile}: {longest}, {several} steps");
        }
    }
}

#[test]
fn tiles_that_no_format_holds_are_refused() {
    let mesh = cleaned(generate::grid(1));
    let budgets = [
        TexelBudget::Density(1e5),
        TexelBudget::Density(1e6),
        TexelBudget::Density(1e30),
        TexelBudget::Total(u64::MAX),
    ];
    for budget in budgets {
        for tile in [0, 128, u32::MAX] {
            let error = build_cover(&mesh, &options(tile, budget.clone())).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::TooLarge);
            let message = error.to_string();
            assert!(message.contains(&format!("the limit is {MAX_EXTENT}")), "{message}");
            assert!(message.contains("--longest-edge"), "{message}");
        }
    }
}

#[test]
fn odd_limits_still_give_covers() {
    let mesh = cleaned(generate::torus(12, 8));
    for facing in [2.0, -1.0, 0.999, f32::NAN] {
        let options = CoverOptions { facing, ..options(64, TexelBudget::Total(100_000)) };
        covered("torus", &mesh, &options);
    }
}

/// Triangles a unit long and `width` wide, side by side and around a tip.
fn needles(width: f64) -> Mesh {
    let mut positions = vec![DVec3::ZERO];
    positions.extend((0..12).map(|i| DVec3::new(1.0, f64::from(i) * width, 0.1 * f64::from(i % 3))));
    let fan = (1..12u32).map(|i| [0, i, i + 1]);
    cleaned(model(positions, fan.collect()))
}

#[test]
fn needles_and_caps() {
    for width in [1e-3, 1e-5, 1e-7] {
        for tile in [0, 64] {
            for budget in [TexelBudget::Total(1000), TexelBudget::Total(1 << 20)] {
                covered("needles", &needles(width), &options(tile, budget));
            }
        }
        // A cap: an obtuse angle of nearly half a turn, between two ordinary triangles.
        let positions = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.5, width, 0.0), DVec3::Y, -DVec3::Y];
        let mesh = cleaned(model(positions, vec![[0, 1, 2], [0, 2, 3], [2, 1, 3], [1, 0, 4]]));
        for tile in [0, 64] {
            covered("cap", &mesh, &options(tile, TexelBudget::Total(1 << 16)));
        }
    }
}

#[test]
fn needles_in_all_directions() {
    // Ten million times as long as wide, in a mesh that was not cleaned of anything.
    let positions =
        vec![Vec3::ZERO, Vec3::new(1.0, 1e-7, 0.0), Vec3::X, Vec3::new(0.0, 1.0, 1e-7), Vec3::Y, Vec3::Z];
    let mesh = raw(positions, vec![[0, 2, 1], [0, 3, 4], [0, 4, 5], [0, 1, 4]]);
    for tile in [0, 64] {
        covered("needles", &mesh, &options(tile, TexelBudget::Total(1 << 16)));
    }
}

/// The ball's triangles are so small that squares of their densities overflow single precision.
#[test]
fn one_stray_vertex_leaves_all_figures_finite() {
    for far in [1e3, 1e5, 1e7] {
        let mut ball = generate::icosphere(4);
        ball.positions[0] = DVec3::new(far, 0.0, 0.0);
        // By itself a model that single precision bends so is refused; one in a space that is given is not.
        let space = WorldFromMesh { offset: DVec3::new(far / 2.0, 0.0, 0.0), scale: far / 2.0 };
        let given = CleanOptions { world_from_mesh: Some(space), ..CleanOptions::default() };
        let (mesh, _) = clean(ball, &given).unwrap();
        let (_, stats) = build_cover(&mesh, &options(64, TexelBudget::Total(1 << 20))).unwrap();
        let figures = [
            stats.worst_share,
            stats.gap_share,
            stats.margin_share,
            stats.overlap_share,
            stats.loss_db,
            stats.lookups_per_sample,
        ];
        assert!(figures.iter().all(|figure| figure.is_finite()), "{far}: {stats:?}");
        assert!(stats.density_share > 0.0 && stats.density_share.is_finite(), "{far}: {stats:?}");
        assert!(stats.worst_share <= stats.density_share, "{far}: {stats:?}");
    }
}

#[test]
fn a_hundred_thousand_components() {
    let positions: Vec<DVec3> = (0..300_000u32)
        .map(|i| {
            let (c, k) = (i / 3, i % 3);
            let corner = DVec3::new(f64::from(c % 317), f64::from(c / 317), f64::from(c % 7));
            corner + 0.7 * [DVec3::ZERO, DVec3::X, DVec3::new(0.2, 0.9, 0.3)][k as usize]
        })
        .collect();
    let mesh = cleaned(model(positions, (0..100_000).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect()));
    for tile in [0, 128] {
        let (cover, stats) = build_cover(&mesh, &options(tile, TexelBudget::Total(64 << 20))).unwrap();
        assert_eq!(stats.fans.projected, 300_000);
        let count = cover.groups.len();
        assert!(if tile == 0 { count == 300_000 } else { (100_000..200_000).contains(&count) }, "{count}");
        // No tile serves two components.
        let mut owner = vec![None; count];
        for (t, groups) in cover.corner_groups.iter().enumerate() {
            assert!(groups.iter().all(|&g| owner[g as usize].replace(t).is_none_or(|other| other == t)));
        }
        assert!(cover.groups.iter().all(|g| g.uv_scale.is_finite() && g.uv_offset.is_finite()));
    }
}

#[test]
fn extreme_gradation() {
    // A spiral of triangles, each nine tenths as long as the one before: from one to a millionth.
    let mut positions = vec![DVec3::ZERO];
    positions.extend((0..130).map(|i| {
        let (sin, cos) = (0.35 * f64::from(i)).sin_cos();
        0.9f64.powi(i) * DVec3::new(cos, sin, 0.05 * f64::from(i % 2))
    }));
    let mesh = cleaned(model(positions, (1..130).map(|i| [0, i, i + 1]).collect()));
    for tile in [0, 64] {
        for total in [2_000, 1 << 20] {
            covered("spiral", &mesh, &options(tile, TexelBudget::Total(total)));
        }
    }
    // A grid whose cells shrink geometrically to one corner.
    let at = |i: u32| 0.5f64.powi(i as i32);
    let positions = (0..400u32).map(|v| DVec3::new(at(v % 20), at(v / 20), 0.2 * at(v % 20))).collect();
    let quad = |v: u32| [[v, v + 20, v + 21], [v, v + 21, v + 1]];
    let triangles = (0..380u32).filter(|v| v % 20 < 19).flat_map(quad).collect();
    let mesh = cleaned(model(positions, triangles));
    for tile in [0, 64] {
        covered("graded grid", &mesh, &options(tile, TexelBudget::Total(1 << 20)));
    }
}
