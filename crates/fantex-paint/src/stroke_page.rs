//! What a stroke has gathered on each page: in memory within a budget, beyond it in a temporary file.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::OnceLock;

use fantex_base::Result;
use fantex_store::PageId;
use glam::Vec4;

use crate::error::temporary;
use crate::texel_page::Rect;

/// One page of level 0 under a stroke.
#[derive(Clone, Debug)]
pub(crate) struct StrokePage {
    /// Per texel, 0..1; row-major.
    pub(crate) coverage: Vec<f32>,
    /// Per painted channel and texel the colours that were laid down, linear RGBA multiplied by alpha and by their share of the
    /// coverage; empty for tools whose colour does not depend on the dab.
    pub(crate) colors: Vec<Vec<Vec4>>,
    /// What the stroke's stencil and sight let through, 0..1 per texel, where there is coverage; empty without these.
    pub(crate) stencil: Vec<f32>,
    /// Texels whose coverage is not zero lie in here.
    pub(crate) touched: Rect,
    /// Texels whose coverage has grown since the page was last shown.
    pub(crate) stale: Rect,
    /// The bytes before the stroke, one per painted channel; empty until the page is first shown.
    pub(crate) originals: Vec<Vec<u8>>,
    /// It is the stroke that puts the page as it was aside, as the base of the layers; known when the page is first shown.
    pub(crate) puts_base_aside: bool,
    /// The originals, decoded: kept while there is room, since neighbouring dabs ask for the same pages.
    pub(crate) decoded: OnceLock<Vec<Vec<Vec4>>>,
}

impl StrokePage {
    pub(crate) fn new(texels: usize) -> Self {
        Self {
            coverage: vec![0.0; texels],
            colors: Vec::new(),
            stencil: Vec::new(),
            touched: Rect::EMPTY,
            stale: Rect::EMPTY,
            originals: Vec::new(),
            puts_base_aside: false,
            decoded: OnceLock::new(),
        }
    }

    /// How far a texel is covered, 0..1: by what was gathered, through the stencil.
    #[inline]
    pub(crate) fn covered(&self, texel: usize) -> f32 {
        match (self.coverage[texel], self.stencil.get(texel)) {
            (gathered, Some(passes)) if gathered > 0.0 => gathered * passes,
            (gathered, _) => gathered,
        }
    }

    /// The colour that was laid on a texel, straight alpha; none where the tool gathers none.
    pub(crate) fn color(&self, channel: usize, texel: usize) -> Option<Vec4> {
        let sum = self.colors.get(channel)?[texel];
        let color = if sum.w > 0.0 { sum.truncate() / sum.w } else { sum.truncate() };
        Some(color.extend((sum.w / self.coverage[texel]).min(1.0)))
    }

    /// A texel has been covered, or covered further.
    pub(crate) fn touch(&mut self, place: [u32; 2]) {
        self.touched.add(place);
        self.stale.add(place);
    }

    /// Lays a colour (one per channel, multiplied by alpha) over what is gathered.
    pub(crate) fn gather(&mut self, texel: usize, added: f32, colors: &[Vec4]) {
        if self.colors.is_empty() && !colors.is_empty() {
            self.colors = vec![vec![Vec4::ZERO; self.coverage.len()]; colors.len()];
        }
        for (gathered, color) in self.colors.iter_mut().zip(colors) {
            gathered[texel] = gathered[texel] * (1.0 - added) + *color * added;
        }
        let coverage = &mut self.coverage[texel];
        *coverage += added * (1.0 - *coverage);
    }

    fn decoded_bytes(&self) -> usize {
        self.decoded.get().map_or(0, |channels| 16 * channels.iter().map(Vec::len).sum::<usize>())
    }

    fn stored_bytes(&self) -> usize {
        4 * (self.coverage.len() * (1 + 4 * self.colors.len()) + self.stencil.len())
            + self.originals.iter().map(Vec::len).sum::<usize>()
    }

    fn memory_bytes(&self) -> usize {
        self.stored_bytes() + self.decoded_bytes()
    }
}

#[derive(Debug)]
struct Spilled {
    place: Place,
    texels: usize,
    colored_channels: usize,
    has_stencil: bool,
    originals: Vec<usize>,
    puts_base_aside: bool,
    touched: Rect,
    stale: Rect,
}

/// A range of the temporary file.
#[derive(Clone, Copy, Debug)]
struct Place {
    offset: u64,
    bytes: u64,
}

#[derive(Debug, Default)]
pub(crate) struct StrokePages {
    pages: BTreeMap<PageId, StrokePage>,
    bytes: usize,
    spilled: BTreeMap<PageId, Spilled>,
    /// Where pages that are in memory lay in the file: they go there again, if they fit.
    vacated: BTreeMap<PageId, Place>,
    file: Option<File>,
    end: u64,
}

impl StrokePages {
    /// Takes a page out, to be given back by [`put`](Self::put). Where it cannot be read it stays.
    pub(crate) fn take(&mut self, id: PageId) -> Result<Option<StrokePage>> {
        if let Some(page) = self.pages.remove(&id) {
            self.bytes -= page.memory_bytes();
            return Ok(Some(page));
        }
        let page = self.read_spilled(id)?;
        if let Some(spilled) = self.spilled.remove(&id) {
            self.vacated.insert(id, spilled.place);
        }
        Ok(page)
    }

    /// Takes pages of so many texels out, new ones where the stroke has not been; all of them or none.
    pub(crate) fn take_or_new(
        &mut self,
        ids: impl IntoIterator<Item = (PageId, usize)>,
    ) -> Result<Vec<(PageId, StrokePage)>> {
        let mut pages = Vec::new();
        for (id, texels) in ids {
            match self.take(id) {
                Ok(page) => pages.push((id, page.unwrap_or_else(|| StrokePage::new(texels)))),
                Err(error) => {
                    pages.into_iter().for_each(|(id, page)| self.keep(id, page));
                    return Err(error);
                }
            }
        }
        Ok(pages)
    }

    /// A page as it is, which stays where it is.
    pub(crate) fn get(&self, id: PageId) -> Result<Option<Cow<'_, StrokePage>>> {
        match self.pages.get(&id) {
            Some(page) => Ok(Some(Cow::Borrowed(page))),
            None => Ok(self.read_spilled(id)?.map(Cow::Owned)),
        }
    }

    /// Keeps a page, if something is covered there; writes some to the temporary file where memory is short. It is kept even where
    /// that fails.
    pub(crate) fn put(&mut self, id: PageId, page: StrokePage, budget_bytes: usize) -> Result<()> {
        self.keep(id, page);
        if self.bytes > budget_bytes / 2 {
            for page in self.pages.values_mut() {
                self.bytes -= page.decoded_bytes();
                page.decoded = OnceLock::new();
            }
        }
        while self.bytes > budget_bytes
            && self.pages.len() > 1
            && let Some((id, page)) = self.pages.pop_first()
        {
            if let Err(error) = self.spill(id, &page) {
                self.pages.insert(id, page);
                return Err(temporary(error));
            }
            self.bytes -= page.memory_bytes();
        }
        Ok(())
    }

    fn keep(&mut self, id: PageId, page: StrokePage) {
        if !page.touched.is_empty() {
            self.bytes += page.memory_bytes();
            self.pages.insert(id, page);
        }
    }

    /// Keeps pages, each of them even where there is no room for more in the temporary file.
    pub(crate) fn put_all(
        &mut self,
        pages: impl IntoIterator<Item = (PageId, StrokePage)>,
        budget_bytes: usize,
    ) -> Result<()> {
        let mut kept = Ok(());
        for (id, page) in pages {
            kept = kept.and(self.put(id, page, budget_bytes));
        }
        kept
    }

    /// All pages, ascending.
    pub(crate) fn ids(&self) -> Vec<PageId> {
        self.ids_where(|_| true)
    }

    /// Pages that have grown since they were last shown, ascending.
    pub(crate) fn stale(&self) -> Vec<PageId> {
        self.ids_where(|[_, stale]| !stale.is_empty())
    }

    fn ids_where(&self, is_chosen: impl Fn([Rect; 2]) -> bool) -> Vec<PageId> {
        let mut ids: Vec<PageId> =
            self.rects().filter(|(_, rects)| is_chosen(*rects)).map(|(id, _)| id).collect();
        ids.sort_unstable();
        ids
    }

    /// The pages of a group with the texels that are covered, relative to the page.
    pub(crate) fn touched(&self, group: u32) -> impl Iterator<Item = (PageId, Rect)> {
        self.rects().filter(move |(id, _)| id.group == group).map(|(id, [touched, _])| (id, touched))
    }

    fn rects(&self) -> impl Iterator<Item = (PageId, [Rect; 2])> {
        let kept = self.pages.iter().map(|(&id, page)| (id, [page.touched, page.stale]));
        kept.chain(self.spilled.iter().map(|(&id, page)| (id, [page.touched, page.stale])))
    }

    fn spill(&mut self, id: PageId, page: &StrokePage) -> io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile()?),
        };
        let bytes = page.stored_bytes() as u64;
        let place = match self.vacated.get(&id) {
            Some(&place) if place.bytes >= bytes => place,
            _ => Place { offset: self.end, bytes },
        };
        file.seek(SeekFrom::Start(place.offset))?;
        let colors = page.colors.iter().flatten().flat_map(|c| c.to_array());
        let numbers = page.coverage.iter().copied().chain(colors).chain(page.stencil.iter().copied());
        let numbers: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
        file.write_all(&numbers)?;
        page.originals.iter().try_for_each(|bytes| file.write_all(bytes))?;
        let spilled = Spilled {
            place,
            texels: page.coverage.len(),
            colored_channels: page.colors.len(),
            has_stencil: !page.stencil.is_empty(),
            originals: page.originals.iter().map(Vec::len).collect(),
            puts_base_aside: page.puts_base_aside,
            touched: page.touched,
            stale: page.stale,
        };
        self.end = self.end.max(place.offset + place.bytes);
        self.vacated.remove(&id);
        self.spilled.insert(id, spilled);
        Ok(())
    }

    fn read_spilled(&self, id: PageId) -> Result<Option<StrokePage>> {
        match (self.spilled.get(&id), &self.file) {
            (Some(spilled), Some(file)) => read_back(file, spilled).map(Some).map_err(temporary),
            _ => Ok(None),
        }
    }
}

fn read_back(mut file: &File, spilled: &Spilled) -> io::Result<StrokePage> {
    file.seek(SeekFrom::Start(spilled.place.offset))?;
    let numbers = 1 + 4 * spilled.colored_channels + usize::from(spilled.has_stencil);
    let mut bytes = vec![0; 4 * spilled.texels * numbers];
    file.read_exact(&mut bytes)?;
    let mut coverage: Vec<f32> =
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let mut numbers = coverage.split_off(spilled.texels);
    let stencil = numbers.split_off(4 * spilled.colored_channels * spilled.texels);
    let texels: Vec<Vec4> = numbers.chunks_exact(4).map(Vec4::from_slice).collect();
    let colors = texels.chunks_exact(spilled.texels.max(1)).map(<[Vec4]>::to_vec).collect();
    let mut originals = Vec::with_capacity(spilled.originals.len());
    for &length in &spilled.originals {
        let mut bytes = vec![0; length];
        file.read_exact(&mut bytes)?;
        originals.push(bytes);
    }
    Ok(StrokePage {
        coverage,
        colors,
        stencil,
        touched: spilled.touched,
        stale: spilled.stale,
        originals,
        puts_base_aside: spilled.puts_base_aside,
        decoded: OnceLock::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_come_back_from_the_file() {
        let mut pages = StrokePages::default();
        let id = |group| PageId { group, level: 0, page: [0, 0] };
        for group in 0..5 {
            let mut page = StrokePage::new(16);
            page.coverage[3] = group as f32;
            page.gather(5, 0.5, &[Vec4::splat(group as f32), Vec4::ONE]);
            if group % 2 == 1 {
                page.stencil = vec![0.25; 16];
            }
            page.touched.add([3, 0]);
            if group % 2 == 0 {
                page.stale.add([3, 0]);
            }
            page.originals = vec![vec![group as u8; 8], vec![7; 4]];
            page.puts_base_aside = group == 1;
            pages.put(id(group), page, 200).unwrap();
        }
        assert_eq!(pages.ids().len(), 5);
        assert_eq!(pages.stale(), [0, 2, 4].map(id));
        for group in 0..5 {
            let page = pages.take(id(group)).unwrap().unwrap();
            assert_eq!((page.coverage[3], page.coverage[4]), (group as f32, 0.0));
            assert_eq!((page.colors.len(), page.colors[0][5]), (2, Vec4::splat(0.5 * group as f32)));
            assert_eq!(page.stencil.len(), 16 * (group % 2) as usize);
            assert_eq!(page.covered(5), if group % 2 == 1 { 0.125 } else { 0.5 });
            assert_eq!(page.originals, [vec![group as u8; 8], vec![7; 4]]);
            assert_eq!(page.puts_base_aside, group == 1);
            assert_eq!(page.touched, Rect { low: [3, 0], high: [4, 1] });
        }
        assert!(pages.take(id(0)).unwrap().is_none());
    }

    #[test]
    fn pages_that_come_and_go_take_no_more_of_the_file_and_unreadable_ones_stay() {
        let id = |group| PageId { group, level: 0, page: [0, 0] };
        let mut pages = StrokePages::default();
        let page = |n: f32| {
            let mut page = StrokePage::new(16);
            page.coverage[0] = n;
            page.touched.add([0, 0]);
            page
        };
        for group in 0..9 {
            pages.put(id(group), page(group as f32), 0).unwrap();
        }
        for round in 0..20 {
            for group in 0..9 {
                let mut page = pages.take(id(group)).unwrap().unwrap();
                assert_eq!(page.coverage[0], (group + round) as f32);
                page.coverage[0] += 1.0;
                pages.put(id(group), page, 0).unwrap();
            }
        }
        // The last page stays in memory.
        assert_eq!(pages.end, 8 * 64);
        // Pages that have grown go elsewhere, once.
        for _ in 0..20 {
            let mut page = pages.take(id(3)).unwrap().unwrap();
            page.originals = vec![vec![5; 10]];
            pages.put(id(3), page, 0).unwrap();
            assert_eq!(pages.get(id(3)).unwrap().unwrap().originals, [[5; 10]]);
            let page = pages.take(id(4)).unwrap().unwrap();
            pages.put(id(4), page, 0).unwrap();
        }
        assert_eq!(pages.end, 8 * 64 + 74);

        pages.file.as_ref().unwrap().set_len(64).unwrap();
        let ids = pages.ids();
        assert!(pages.take_or_new(ids.iter().map(|&id| (id, 16))).is_err());
        assert_eq!(pages.ids(), ids);
    }
}
