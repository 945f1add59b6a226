//! Size and error of assets beside one with the exact texels: bits per texel of all levels and channels together, and the error of
//! each channel over all blocks that are stored.
//!
//! `cargo run --release -p fantex-bench --example packed_error -- EXACT.fan FILE.fan...`
//!
//! The exact asset is the same bake with `--format rgba8`.

use std::path::Path;

use fantex_store::{Asset, decode, group_pages};

type AnyError = Box<dyn std::error::Error>;

fn main() -> Result<(), AnyError> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let (exact, files) = paths.split_first().ok_or("expected an asset with exact texels, then others")?;
    let exact = Asset::open(Path::new(exact))?;
    files.iter().try_for_each(|path| measure(&exact, Path::new(path)))
}

fn measure(exact: &Asset, path: &Path) -> Result<(), AnyError> {
    let asset = Asset::open(path)?;
    let clusters = asset.clusters().map(|cluster| asset.cluster_range(cluster));
    let bytes: u64 = clusters.map(|range| range.end - range.start).sum();
    let channels = asset.channels();
    let mut squares = vec![0.0; channels.len()];
    let mut counts = vec![0u64; channels.len()];
    for (number, group) in (0..).zip(&asset.cover().groups) {
        for id in group_pages(number, group) {
            let extent = asset.page_extent(0, id)?;
            let columns = extent[0] as usize / 4;
            for (index, channel) in channels.iter().enumerate() {
                let stored = asset.read_page_raw(index, id)?;
                let texels = decode(channel.format, extent, &stored)?;
                let exact_format = exact.channels()[index].format;
                let exact = decode(exact_format, extent, &exact.read_page_raw(index, id)?)?;
                let values = channel.format.channel_count().min(3);
                for (i, (texel, exact)) in texels.iter().zip(exact).enumerate() {
                    let block = i / extent[0] as usize / 4 * columns + i % extent[0] as usize / 4;
                    let length = channel.format.block_bytes();
                    if stored[block * length..][..length].iter().any(|&byte| byte != 0) {
                        squares[index] +=
                            (0..values).map(|k| f64::from(texel[k] - exact[k]).powi(2)).sum::<f64>();
                        counts[index] += values as u64;
                    }
                }
            }
        }
    }
    let texels: u64 = asset.cover().groups.iter().map(|group| group.texels()).sum();
    print!(
        "{}: {:.2} MB, {:.2} bits per texel",
        path.display(),
        bytes as f64 / 1e6,
        8.0 * bytes as f64 / texels as f64
    );
    for ((channel, sum), count) in channels.iter().zip(squares).zip(counts) {
        print!(", {:?} {:.2} dB", channel.kind, 10.0 * (count as f64 / sum).log10());
    }
    println!();
    Ok(())
}
