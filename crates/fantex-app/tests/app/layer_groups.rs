//! Groups in the list of layers: its lines, where what is dragged goes, and what that does.

use std::collections::BTreeSet;

use fantex::paint::{BlendMode, GroupKind, Layer, LayerContent, LayerPlace, Target};
use fantex_app::paint::{LayerAction, LayerRow, PaintCommand, drop_place, layer_rows};
use fantex_app::session::LayerStep;

use crate::painting::Studio;

fn act(studio: &mut Studio, action: LayerAction) {
    studio.painting.layer_action(&action, &studio.settings).unwrap();
    studio.wait();
}

/// Names with the groups around them, from the top.
fn listed(studio: &Studio) -> Vec<String> {
    let rows = layer_rows(&studio.painting.snapshot.layers, &studio.painting.snapshot.collapsed, None);
    rows.iter().map(|(row, layer)| format!("{}{}", "  ".repeat(row.depth), layer.name)).collect()
}

/// Three layers, of which the first two lie in a group; all numbers by name.
fn grouped() -> (Studio, [u64; 3], u64) {
    let mut studio = Studio::open();
    for _ in 0..3 {
        act(&mut studio, LayerAction::Add);
    }
    let ids = [0, 1, 2].map(|k: usize| studio.painting.snapshot.layers[k].id());
    act(&mut studio, LayerAction::Group(ids[1]));
    let group = studio.painting.snapshot.layers[2].id();
    assert_eq!(studio.painting.target, Target::Layer(group), "the group is chosen");
    act(&mut studio, LayerAction::MoveTo(ids[0], LayerPlace::Into(group), false));
    assert_eq!(listed(&studio), ["Layer 3", "Group 1", "  Layer 1", "  Layer 2"]);
    (studio, ids, group)
}

#[test]
fn groups_are_made_dissolved_folded_and_deleted() {
    let (mut studio, ids, group) = grouped();
    let steps = studio.painting.snapshot.done.len();
    act(&mut studio, LayerAction::Collapse(group, true));
    assert_eq!(listed(&studio), ["Layer 3", "Group 1"]);
    // A new layer comes above a folded group, and into one that is not.
    studio.painting.target = Target::Layer(group);
    act(&mut studio, LayerAction::Add);
    assert_eq!(listed(&studio), ["Layer 3", "Layer 4", "Group 1"]);
    studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
    studio.wait();
    act(&mut studio, LayerAction::Collapse(group, false));
    assert_eq!(studio.painting.snapshot.done.len(), steps, "folding is no step");
    studio.painting.target = Target::Layer(group);
    act(&mut studio, LayerAction::Add);
    assert_eq!(listed(&studio), ["Layer 3", "Group 1", "  Layer 4", "  Layer 1", "  Layer 2"]);
    // Layer by layer downwards and up again, through the group.
    act(&mut studio, LayerAction::Move(ids[2], false));
    assert_eq!(listed(&studio)[..2], ["Group 1", "  Layer 3"]);
    for _ in 0..4 {
        act(&mut studio, LayerAction::Move(ids[2], false));
    }
    assert_eq!(listed(&studio).last().unwrap(), "Layer 3");
    act(&mut studio, LayerAction::Move(ids[2], true));
    assert_eq!(listed(&studio).last().unwrap(), "  Layer 3");
    act(&mut studio, LayerAction::Collapse(group, true));
    act(&mut studio, LayerAction::Ungroup(group));
    assert_eq!(listed(&studio), ["Layer 4", "Layer 1", "Layer 2", "Layer 3"]);
    studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
    studio.wait();
    assert_eq!(listed(&studio), ["Group 1"], "it is folded as before");
    act(&mut studio, LayerAction::Delete(group));
    assert!(studio.painting.snapshot.layers.is_empty() && studio.painting.target == Target::Base);
}

#[test]
fn a_drag_into_a_group_and_out_of_it_is_one_step() {
    let (mut studio, ids, group) = grouped();
    let steps = studio.painting.snapshot.done.len();
    let before = studio.painting.snapshot.layers.clone();
    act(&mut studio, LayerAction::MoveTo(ids[2], LayerPlace::Into(group), false));
    act(&mut studio, LayerAction::MoveTo(ids[2], LayerPlace::Below(ids[0]), true));
    assert_eq!(listed(&studio), ["Group 1", "  Layer 1", "  Layer 3", "  Layer 2"]);
    assert_eq!(studio.painting.snapshot.done.len(), steps + 1);
    // Back where it was: no step is left, and going on takes back none of those before.
    act(&mut studio, LayerAction::MoveTo(ids[2], LayerPlace::Top, true));
    assert_eq!((studio.painting.snapshot.done.len(), &studio.painting.snapshot.layers), (steps, &before));
    act(&mut studio, LayerAction::MoveTo(ids[2], LayerPlace::Into(group), true));
    assert_eq!(studio.painting.snapshot.done.len(), steps + 1);
    studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
    studio.wait();
    assert_eq!(studio.painting.snapshot.layers, before);
}

#[test]
fn groups_are_painted_through_their_masks_only_and_merged() {
    let (mut studio, ids, group) = grouped();
    let said = |studio: &mut Studio, words: &str| {
        let steps = studio.painting.snapshot.done.len();
        studio.stroke();
        assert_eq!(studio.painting.snapshot.done.len(), steps);
        assert!(studio.notices.shown().any(|notice| notice.text.contains(words)), "{words}");
    };
    studio.painting.target = Target::Layer(group);
    said(&mut studio, "A group is chosen");
    act(&mut studio, LayerAction::Show(group, false));
    studio.painting.target = Target::Layer(ids[0]);
    said(&mut studio, "The layer's group is hidden");
    act(&mut studio, LayerAction::Show(group, true));
    studio.stroke();
    act(&mut studio, LayerAction::GroupKind(group, GroupKind::Isolated));
    act(&mut studio, LayerAction::Blend(group, BlendMode::Multiply));
    act(&mut studio, LayerAction::AddMask(group, true));
    assert_eq!(studio.painting.target, Target::Mask(group));
    studio.stroke();
    assert_eq!(studio.painting.snapshot.done.last().unwrap(), "paint");
    act(&mut studio, LayerAction::MergeGroup(group));
    let layers = &studio.painting.snapshot.layers;
    let merged = layers.iter().find(|layer| layer.id() == group).unwrap();
    assert_eq!(
        (layers.len(), merged.blend, &merged.content),
        (2, BlendMode::Multiply, &LayerContent::Painted)
    );
    let path = studio.path.clone();
    let _folder = studio.close();
    let report = fantex::store::verify(&path, &fantex::store::VerifyOptions::default()).unwrap();
    assert!(report.ok);
}

#[test]
fn lines_say_where_a_dragged_layer_goes() {
    let rows = |names: &[(u64, Option<u64>, bool)]| -> Vec<LayerRow> {
        // Groups come before their members here.
        let depth = |mut id: Option<u64>| {
            let mut depth = 0;
            while let Some(parent) = id {
                depth += 1;
                id = names.iter().find(|row| row.0 == parent).unwrap().1;
            }
            depth
        };
        let row = |&(id, parent, is_open): &(u64, Option<u64>, bool)| LayerRow {
            id,
            parent,
            depth: depth(parent),
            is_group: id >= 10,
            is_open,
        };
        names.iter().map(row).collect()
    };
    let list = rows(&[
        (1, None, false),
        (10, None, true),
        (2, Some(10), false),
        (3, Some(10), false),
        (11, None, false),
        (4, None, false),
    ]);
    let place = |dragged, onto, steps| drop_place(&list, dragged, onto, steps);
    assert_eq!(place(1, 1, 0), Some(LayerPlace::Into(10)), "down onto an unfolded group");
    assert_eq!(place(1, 3, 0), Some(LayerPlace::Below(3)));
    assert_eq!(place(1, 4, 0), Some(LayerPlace::Below(11)), "a folded group is passed");
    assert_eq!(place(4, 9, 0), None, "it is there");
    assert_eq!(place(4, 2, 0), Some(LayerPlace::Above(2)));
    assert_eq!(place(4, 1, 0), Some(LayerPlace::Above(10)), "up past a group");
    assert_eq!(place(3, 3, -1), Some(LayerPlace::Below(10)), "the lowest goes out to the left");
    assert_eq!(place(2, 2, -1), None, "what lies above others stays");
    assert_eq!(place(4, 5, 1), Some(LayerPlace::Into(11)), "to the right into the group above");
    assert_eq!(place(11, 4, 1), Some(LayerPlace::Below(3)), "a group, too, at the bottom of it");
    assert_eq!(place(3, 3, 1), None, "above it lies no group");
    assert_eq!(place(77, 0, 0), None);
}

/// A group that is dragged is one line; what is folded is not listed.
#[test]
fn lists_leave_out_what_is_folded() {
    let (studio, ids, group) = grouped();
    let layers: &[Layer] = &studio.painting.snapshot.layers;
    let ids_of = |collapsed: &BTreeSet<u64>, dragged| -> Vec<(u64, usize, bool)> {
        let rows = layer_rows(layers, collapsed, dragged);
        rows.into_iter().map(|(row, _)| (row.id, row.depth, row.is_open)).collect()
    };
    let all = [(ids[2], 0, false), (group, 0, true), (ids[0], 1, false), (ids[1], 1, false)];
    assert_eq!(ids_of(&BTreeSet::new(), None), all);
    let closed = [(ids[2], 0, false), (group, 0, false)];
    assert_eq!(ids_of(&BTreeSet::from([group]), None), closed);
    assert_eq!(ids_of(&BTreeSet::new(), Some(group)), closed);
}

/// Steps of sessions that name a layer or need one say which is not there.
#[test]
fn steps_of_sessions_name_the_layer_that_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = crate::panels::with_painting(folder.path());
    crate::panels::wait_painted(&mut viewer);
    let mut refused = |step: LayerStep| viewer.layer_step(step).unwrap_err().to_string();
    assert_eq!(refused(LayerStep::Select("Dirt".into())), "there is no layer named \"Dirt\"");
    assert_eq!(refused(LayerStep::Delete), "no layer is chosen: the base is painted on");
    viewer.layer_step(LayerStep::SeeMask(false)).unwrap();
    viewer.layer_step(LayerStep::Select("base".into())).unwrap();
}
