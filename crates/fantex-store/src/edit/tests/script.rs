//! A small asset, changes to it, and what it must hold after them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::common::{encoded_page, fan_cover, means, pages, plain_channels, sheet, write};
use crate::{Asset, AssetEditor, EditError, PageId, VerifyOptions};

/// All that an asset holds and that commits change.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct State {
    pub(super) pages: BTreeMap<(PageId, usize), Vec<u8>>,
    pub(super) means: Vec<[f32; 4]>,
    pub(super) attachments: BTreeMap<String, Vec<u8>>,
}

impl State {
    /// Reads everything, which checks all checksums.
    pub(super) fn read(asset: &Asset) -> State {
        let mut state = State::default();
        let channels = asset.channels().len();
        for id in pages(asset.cover()) {
            for channel in 0..channels {
                state.pages.insert((id, channel), asset.read_page_raw(channel, id).unwrap());
            }
        }
        for group in 0..asset.cover().groups.len() as u32 {
            state.means.extend((0..channels).map(|channel| asset.mean(channel, group)));
        }
        for name in asset.attachment_names().unwrap() {
            let contents = asset.attachment(name).unwrap().unwrap();
            state.attachments.insert(name.to_owned(), contents);
        }
        state
    }

    pub(super) fn open(path: &Path) -> (u64, State) {
        let asset = Asset::open(path).unwrap();
        (asset.generation(), State::read(&asset))
    }
}

/// Tiles of one page and of several.
pub(super) fn small_asset(folder: &Path) -> PathBuf {
    let path = folder.join("small.fan");
    let mesh = sheet(2);
    let cover = fan_cover(&mesh, |v| [[16, 12], [4, 4], [260, 8], [32, 32]][v % 4]);
    let channels = plain_channels();
    write(&path, &mesh, &cover, &channels, 100).unwrap();
    assert_eq!(State::open(&path).1.means, means(&cover, &channels));
    path
}

/// A few numbers that look random.
pub(super) struct Dice(pub(super) u64);

impl Dice {
    pub(super) fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) % n as u64) as usize
    }
}

/// Makes some changes, in the editor and in the state that is expected of it.
pub(super) fn change(editor: &mut AssetEditor, state: &mut State, dice: &mut Dice) {
    let cover = editor.asset().cover().clone();
    let channels = plain_channels();
    let all: Vec<PageId> = pages(&cover).collect();
    for _ in 0..1 + dice.below(6) {
        let id = all[dice.below(all.len())];
        let channel = dice.below(channels.len());
        let mut bytes = encoded_page(&cover, &channels, id).channels[channel].clone();
        let shift = dice.below(256) as u8;
        if channels[channel].format.block_bytes() < 256 {
            bytes.iter_mut().for_each(|b| *b = b.wrapping_add(shift));
        } else {
            bytes
                .chunks_exact_mut(4)
                .for_each(|x| x.copy_from_slice(&(f32::from(shift) / 3.0).to_le_bytes()));
        }
        editor.replace(id, channel, bytes.clone()).unwrap();
        state.pages.insert((id, channel), bytes);
        let mean = [dice.below(64) as f32, 0.5, 0.25, 1.0];
        editor.set_mean(channel, id.group, mean);
        state.means[id.group as usize * channels.len() + channel] = mean;
    }
    let name = format!("layer/{}", dice.below(4));
    if dice.below(3) == 0 {
        editor.detach(&name);
        state.attachments.remove(&name);
    } else {
        let contents = vec![dice.below(256) as u8; dice.below(9000)];
        editor.attach(&name, contents.clone()).unwrap();
        state.attachments.insert(name, contents);
    }
}

/// What the editor shows of its uncommitted state.
pub(super) fn seen_by(editor: &AssetEditor) -> Result<State, EditError> {
    let mut state = State::default();
    let asset = editor.asset();
    for id in pages(asset.cover()) {
        for channel in 0..asset.channels().len() {
            state.pages.insert((id, channel), editor.read_page_raw(channel, id)?);
        }
    }
    for group in 0..asset.cover().groups.len() as u32 {
        state.means.extend((0..asset.channels().len()).map(|channel| editor.mean(channel, group)));
    }
    for name in editor.attachment_names() {
        let contents = editor.attachment(&name)?.unwrap();
        state.attachments.insert(name, contents);
    }
    Ok(state)
}

/// Checksums of everything.
pub(super) fn assert_whole(path: &Path) {
    let report = crate::verify(path, &VerifyOptions::default()).unwrap();
    assert_eq!((report.damaged_tiles, report.damaged_headers, report.damaged_attachments), (0, 0, 0));
}
