//! Numbers that stand in several languages, here and in the page's half of `@fantex/three`, and must agree.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use fantex_store::{ChannelKind, TexelFormat};
use fantex_stream::AtlasFormat;
use fantex_stream::drawing::PAGE_ROW_SHIFT;

const TEXTURES: &str = include_str!("../../../three/src/textures.js");
const SHADER: &str = include_str!("../../../three/src/shader.js");
const NODES: &str = include_str!("../../../three/src/shaderNodes.js");
const LOOKUP: &str = include_str!("../../fantex-gpu/src/shaders/fan_lookup.wgsl");
const SAMPLER: &str = include_str!("../../fantex-store/src/sampler/lookup.rs");

/// What a constant is declared as, up to the end of its declaration.
fn constant<'a>(source: &'a str, name: &str) -> &'a str {
    let mut declarations = source.split("const ").skip(1).filter_map(|rest| {
        let (left, right) = rest.split_once('=')?;
        let declared = left.split(':').next()?.split_whitespace().last()?;
        (declared == name).then_some(right)
    });
    declarations.next().unwrap_or_else(|| panic!("no constant {name}")).split(';').next().unwrap().trim()
}

fn number(source: &str, name: &str) -> f32 {
    constant(source, name).trim_end_matches('u').parse().unwrap()
}

#[test]
fn tables_have_as_many_columns() {
    let columns = 1 << PAGE_ROW_SHIFT;
    assert_eq!(constant(TEXTURES, "COLUMNS"), columns.to_string());
    assert_eq!(number(LOOKUP, "PAGE_ROW_SHIFT"), PAGE_ROW_SHIFT as f32);
    let mask = columns - 1;
    let entries = SHADER.split("ivec2(").skip(1).map(|rest| rest.split(')').next().unwrap());
    let mut found = 0;
    for entry in entries.filter(|entry| entry.contains('&')) {
        let index = entry.split(' ').next().unwrap();
        assert_eq!(entry, format!("{index} & {mask}u, {index} >> {PAGE_ROW_SHIFT}u"));
        found += 1;
    }
    assert_eq!(found, 4, "of groups, pages, means and frames");
    let entry =
        format!("ivec2(int(index.bitAnd(uint({mask}))), int(index.shiftRight(uint({PAGE_ROW_SHIFT}))))");
    assert!(NODES.contains(&entry), "{entry}");
}

#[test]
fn formats_and_kinds_have_their_codes() {
    let formats = constant(TEXTURES, "FORMATS").trim_matches(['[', ']']).trim();
    let formats: Vec<&str> = formats.lines().map(|line| line.trim().trim_end_matches(',')).collect();
    let expected = TexelFormat::ALL.map(|format| {
        let [block, plain] = [true, false].map(|has_blocks| AtlasFormat::of(format, has_blocks));
        let name = |format: AtlasFormat| format!("\"{format:?}\"").to_lowercase();
        let block = if block.is_compressed() { name(block) } else { "null".into() };
        format!("{{ block: {block}, plain: {} }}", name(plain))
    });
    assert_eq!(formats, expected);
    let kinds = [
        ("BASE_COLOR", ChannelKind::BaseColor),
        ("NORMAL", ChannelKind::Normal),
        ("MATERIAL", ChannelKind::OcclusionRoughnessMetallic),
        ("EMISSION", ChannelKind::Emission),
        ("LIGHT", ChannelKind::Light),
    ]
    .map(|(name, kind)| format!("{name} = {}", kind as u32));
    let declaration = format!("export const {};", kinds.join(", "));
    assert!(TEXTURES.contains(&declaration), "{declaration}");
}

#[test]
fn shaders_fade_pages_and_hold_footprints_alike() {
    let fade = number(LOOKUP, "FADE_TEXELS");
    assert_eq!([number(SHADER, "FAN_FADE_TEXELS"), number(NODES, "FADE_TEXELS")], [fade; 2]);
    let longest = number(LOOKUP, "MAX_FOOTPRINT");
    assert_eq!([number(SHADER, "FAN_MAX_FOOTPRINT"), number(NODES, "MAX_FOOTPRINT")], [longest; 2]);
    assert_eq!(constant(SAMPLER, "MAX_FOOTPRINT"), format!("(1 << {}) as f32", longest.log2()));
}

/// An asset becomes sharp as quickly in the viewer for pages.
#[test]
fn both_cores_of_pages_upload_as_much_per_frame() {
    let (viewer, core) = (include_str!("../../fantex-web/src/viewer.rs"), include_str!("../src/core.rs"));
    for name in ["UPLOAD_BYTES", "MAX_FRAME_SECONDS"] {
        assert_eq!(constant(viewer, name), constant(core, name), "{name}");
    }
}
