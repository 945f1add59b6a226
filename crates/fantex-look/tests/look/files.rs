//! Looks from files: what is read, and what is refused with which words.

use std::path::Path;

use fantex_look::LookFile;
use fantex_look::data::{Input, LightTable, TextureTable};

fn parse(text: &str) -> Result<LookFile, String> {
    LookFile::parse(text, Path::new("scene.toml")).map_err(|e| e.to_string())
}

/// The text is refused with a message that holds all parts.
#[track_caller]
fn refused(text: &str, parts: &[&str]) {
    let message = parse(text).map(|file| format!("{:?}", file.look())).expect_err("should be refused");
    for part in parts {
        assert!(message.contains(part), "'{part}' is missing in: {message}");
    }
    assert!(!message.contains('\n'), "more than one line: {message}");
}

const SCENE: &str = r##"
[camera]
eye = [3, 2, 5]
fov = 40

[picture]
size = [320, 200]
filter = "ewa"

[environment]
sky = { turbidity = 4 }

[[light]]
kind = "sun"
to_light = [1, 2, 1]
shadow = {}

[[light]]
kind = "ambient"
sky = "#8080ff"

[textures.rings]
kind = "wood"
tilt = 12
place = { scale = 2, rotate = [0, 0, 90] }

[textures.bumps]
kind = "noise"
family = "simplex"

[textures.bark]
kind = "layers"
base = "rings"
layers = [{ texture = "#804000", mask = "bumps.r", opacity = 0.5 }]

[materials.board]
base_color = "bark"
roughness = { texture = "bumps", factor = 0.5, offset = 0.2 }
bump = { texture = "bumps", height = 0.02 }

[[object]]
shape = { kind = "torus" }
material = "board"
"##;

#[test]
fn a_wrap_is_one_text_or_two() {
    for wrap in ["\"mirror\"", "[\"clamp\", \"border\"]"] {
        let text = format!("[textures.a]\nkind = \"image\"\nimage = \"a.png\"\nwrap = {wrap}\n");
        assert!(parse(&text).is_ok(), "{wrap}");
    }
}

#[test]
fn a_whole_scene_is_read() {
    let file = parse(SCENE).unwrap();
    let look = file.look();
    assert_eq!(look.camera.as_ref().unwrap().eye, Some([3.0, 2.0, 5.0]));
    assert_eq!(look.picture.size.map(|side| side.0), [320, 200]);
    assert!(matches!(&look.light[0], LightTable::Sun(sun) if sun.shadow.is_some()));
    assert!(
        matches!(&look.textures["rings"], TextureTable::Wood(wood) if wood.texture.tilt == 12.0 && wood.texture.twist == 0.012)
    );
    let Some(Input::Texture(roughness)) = &look.materials["board"].roughness else { panic!() };
    assert_eq!((roughness.texture.0.as_str(), roughness.offset), ("bumps", 0.2));
}

#[test]
fn what_is_written_is_read_alike() {
    let look = parse(SCENE).unwrap().look().clone();
    let text = look.to_toml().unwrap();
    assert_eq!(parse(&text).unwrap().look(), &look, "{text}");
    // Defaults are not written.
    assert!(!text.contains("twist") && text.len() < 1200, "{text}");
}

/// The word that options have, and another one for it.
#[test]
fn the_channel_of_roughness_has_two_names() {
    for channel in ["orm", "surface"] {
        let text = format!("[textures.worn]\nkind = \"asset\"\nasset = \"a.fan\"\nchannel = \"{channel}\"\n");
        let written = parse(&text).unwrap().look().to_toml().unwrap();
        assert!(written.contains(&format!("channel = \"{channel}\"")), "{written}");
    }
}

#[test]
fn unknown_keys_come_with_a_suggestion() {
    refused(
        "[camera]\nfovy = 40\n",
        &["scene.toml:2: camera: there is no key 'fovy'", "did you mean 'fov'?", "allowed are"],
    );
    refused(
        "[textures.a]\nkind = \"noise\"\nocaves = 3\n",
        &["scene.toml:3: textures.a:", "did you mean 'octaves'?"],
    );
    refused("[texture.a]\nkind = \"noise\"\n", &["scene.toml:1:", "did you mean 'textures'?"]);
    refused(
        "[[light]]\nkind = \"sun\"\nto_light = [0, 1, 0]\n[[light]]\nkind = \"sun\"\nto_light = [0, 1, 0]\ncolour = 1\n",
        &["scene.toml:7: light[2]:", "did you mean 'color'?"],
    );
}

#[test]
fn unknown_values_come_with_those_allowed() {
    refused(
        "[textures.a]\nkind = \"nosie\"\n",
        &["scene.toml:2: textures.a.kind: 'nosie' is not known", "did you mean 'noise'?"],
    );
    refused("[picture]\nfilter = \"cubic\"\n", &["picture.filter", "bicubic"]);
    refused(
        "[textures.a]\nkind = \"image\"\nimage = \"a.png\"\ncoordinates = \"cylindre\"\n",
        &["scene.toml:4:", "did you mean 'cylinder'?"],
    );
    refused(
        "[textures.a]\nkind = \"image\"\nimage = \"a.png\"\ncoordinates = { from = \"bax\" }\n",
        &["coordinates.from", "'box'"],
    );
    refused(
        "[textures.a]\nkind = \"image\"\nimage = \"a.png\"\nwrap = [\"repeat\", \"clmap\"]\n",
        &["wrap[2]", "'clamp'"],
    );
}

#[test]
fn wrong_types_are_named() {
    refused(
        "[camera]\nfov = \"wide\"\n",
        &["scene.toml:2: camera.fov: expected a number, found the text \"wide\""],
    );
    refused("[camera]\neye = 3\n", &["camera.eye: expected a list of 3 entries, found the number 3"]);
    refused("[camera]\neye = [1]\n", &["camera.eye: expected a list of 3 entries, found 1 entry"]);
    refused("[camera]\neye = [1, 2]\n", &["camera.eye: expected a list of 3 entries, found 2"]);
    refused("[camera]\neye = [1, \"2\", 3]\n", &["camera.eye[2]: expected a number"]);
    refused("textures = 3\n", &["textures: expected a table"]);
    refused("[materials.a]\nroughness = true\n", &["expected a number, a colour or a texture, found true"]);
    refused("[materials.a]\nbase_color = \"#12345\"\n", &["expected a colour such as"]);
    refused("[picture]\nbackground = \"sky\"\n", &["picture.background: expected"]);
    refused("[materials.a]\nbase_color = 1979-05-27\n", &["found a date"]);
    refused("light = 4\n", &["light: expected a list"]);
}

#[test]
fn numbers_out_of_range_are_named() {
    refused("[camera]\nfov = 180\n", &["camera.fov: expected a number above 0 and below 180, found 180"]);
    refused("[picture]\nsamples = 65\n", &["from 1 to 64, found 65"]);
    refused(
        "[[light]]\nkind = \"sun\"\nshadow = { size = 8193 }\n",
        &["light[1].shadow.size: expected a number from 16 to 8192, found 8193"],
    );
    refused("[picture]\nsize = [0, 20]\n", &["picture.size[1]: expected a number from 1 to 16384, found 0"]);
    refused(
        "[camera]\nfov = nan\n",
        &["scene.toml:2: camera.fov: expected a number that is finite, found nan"],
    );
    refused("[camera]\neye = [0, inf, 0]\n", &["camera.eye[2]: expected a number that is finite, found inf"]);
    refused("[camera]\neye = [0, 1e39, 0]\n", &["between -1e30 and 1e30"]);
    refused("[textures.a]\nkind = \"noise\"\ncell = 1e-40\n", &["textures.a.cell", "no closer to 0"]);
    refused("[textures.a]\nkind = \"wood\"\nplace = { scale = 0 }\n", &["other than 0"]);
    refused("[picture]\nsamples = 99999999999999999999\n", &["picture.samples"]);
    refused("[textures.a]\nkind = \"noise\"\nseed = 5000000000\n", &["textures.a.seed"]);
    refused("[picture]\nsamples = 2.5\n", &["picture.samples: expected a whole number"]);
}

#[test]
fn missing_keys_are_named() {
    refused("[textures.a]\noctaves = 3\n", &["scene.toml:1: textures.a: the key 'kind' is missing"]);
    refused("[textures.a]\nkind = \"ramp\"\ninput = 1\n", &["textures.a: the key 'stops' is missing"]);
    refused("[[light]]\nkind = \"spot\"\nposition = [0, 0, 0]\n", &["light[1]: the key 'target' is missing"]);
    refused("[materials.a]\nbump = { height = 1 }\n", &["materials.a.bump: the key 'texture' is missing"]);
}

#[test]
fn undefined_names_are_refused() {
    refused(
        "[textures.rings]\nkind = \"wood\"\n[materials.a]\nbase_color = \"rigns\"\n",
        &[
            "scene.toml:4: materials.a.base_color: there is no texture 'rigns' in this look",
            "did you mean 'rings'?",
        ],
    );
    refused(
        "[[object]]\nmaterial = \"gold\"\n",
        &["object[1].material: there is no material 'gold'", "none is defined"],
    );
    refused("[environment]\ncapture = { object = \"me\" }\n", &["there is no object 'me'"]);
    refused("[textures.\"a.b\"]\nkind = \"wood\"\n", &["must not be empty, start with '#' or hold a dot"]);
}

#[test]
fn circles_are_spelled_out() {
    let swizzle = |input: &str| {
        format!("kind = \"swizzle\"\ninput = \"{input}\"\nchannels = [\"r\", \"g\", \"b\", \"a\"]\n")
    };
    let text = format!(
        "[textures.a]\n{}[textures.b]\n{}[textures.c]\n{}",
        swizzle("b"),
        swizzle("c.r"),
        swizzle("a")
    );
    refused(&text, &["scene.toml:", "need each other in a circle: a -> b -> c -> a"]);
    refused(&format!("[textures.a]\n{}", swizzle("a")), &["a -> a"]);
    // A long chain is no circle, but too deep.
    let mut chain = "[textures.t0]\nkind = \"wood\"\n".to_owned();
    for i in 1..=80 {
        chain.push_str(&format!("[textures.t{i}]\n{}", swizzle(&format!("t{}", i - 1))));
    }
    refused(&chain, &["more than 64 textures"]);
}

#[test]
fn broken_text_is_refused_with_its_line() {
    refused("[camera\n", &["scene.toml:1: this is no TOML:"]);
    refused("[camera]\nfov = 1\nfov = 2\n", &["scene.toml:3:", "no TOML"]);
    refused(&"a = [".repeat(2000), &["scene.toml:1:"]);
}

#[test]
fn missing_files_are_refused() {
    let message = LookFile::read(Path::new("/no/such/look.toml")).unwrap_err().to_string();
    assert!(message.starts_with("/no/such/look.toml: the look cannot be read:"), "{message}");
}

#[test]
fn whole_numbers_beyond_64_bits_are_named() {
    let expected = "expected a number of at most 64 bits";
    refused("[camera]\nfov = 99999999999999999999\n", &["scene.toml:2: camera.fov", expected]);
    refused("[picture]\nsamples = -99999999999999999999\n", &["scene.toml:2: picture.samples", expected]);
}
