//! Which triangles a group is looked up on.

use fantex_cover::Cover;

/// The triangles of all groups.
#[derive(Debug)]
pub(crate) struct GroupTriangles {
    /// Per group where its triangles begin, and their number.
    firsts: Vec<u32>,
    /// Group by group, ascending.
    triangles: Vec<u32>,
}

impl GroupTriangles {
    /// Of the first so many triangles of a cover.
    pub(crate) fn new(cover: &Cover, count: usize) -> Self {
        let corners = &cover.corner_groups[..count];
        let mut firsts = vec![0u32; cover.groups.len() + 1];
        for groups in corners {
            distinct(groups).for_each(|group| firsts[group as usize + 1] += 1);
        }
        let mut sum = 0;
        for first in &mut firsts {
            sum += *first;
            *first = sum;
        }
        let mut next = firsts.clone();
        let mut triangles = vec![0; sum as usize];
        for (t, groups) in (0..).zip(corners) {
            for group in distinct(groups) {
                let place = &mut next[group as usize];
                triangles[*place as usize] = t;
                *place += 1;
            }
        }
        Self { firsts, triangles }
    }

    /// Those with a corner in a group, ascending.
    pub(crate) fn of(&self, group: u32) -> &[u32] {
        let group = group as usize;
        &self.triangles[self.firsts[group] as usize..self.firsts[group + 1] as usize]
    }
}

/// The groups of a triangle's corners, each once.
fn distinct(groups: &[u32; 3]) -> impl Iterator<Item = u32> {
    (0..3).filter(|&i| !groups[..i].contains(&groups[i])).map(|i| groups[i])
}
