//! What a loader has done and is doing.

/// Counts since the loader was opened, then the present state. For tables and graphs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoaderStatistics {
    /// Reads made.
    pub reads: u64,
    /// Bytes read, with gaps between clusters and what alignment adds.
    pub bytes_read: u64,
    /// Clusters read.
    pub clusters_read: u64,
    /// Stored bytes of those.
    pub cluster_bytes: u64,
    /// Bytes of the pages of clusters that were unpacked, as they are stored without packing: block-compressed texels.
    pub unpacked_bytes: u64,
    /// Stored bytes of the parcels that were handed over: their shares of their clusters. With [`Self::bytes_read`] it tells how
    /// much was read in vain (less than nothing where the cache served parcels more than once).
    pub bytes_needed: u64,
    /// Clusters that were read although, when they came, nobody wanted anything of them any more.
    pub clusters_dropped: u64,
    /// Clusters that were read again after an error.
    pub retries: u64,
    /// Clusters that were given up.
    pub clusters_failed: u64,
    /// Parcels that arrived.
    pub parcels: u64,
    /// Their bytes in the atlas' formats.
    pub parcel_bytes: u64,
    /// Parcels that came from a cluster which was at hand.
    pub cache_hits: u64,
    /// Parcels that arrived as errors.
    pub parcels_failed: u64,
    /// Time from submission to completion, summed over reads.
    pub read_seconds: f64,
    /// Time of checksums, unpacking, decoding and assembling, summed over workers.
    pub unpack_seconds: f64,

    /// Clusters that wait to be read.
    pub queued_clusters: usize,
    /// Reads in flight.
    pub reads_in_flight: usize,
    /// The most reads there have been in flight.
    pub most_reads_in_flight: usize,
    /// Stored bytes that are being read or wait to be unpacked.
    pub flight_bytes: usize,
    /// Bytes of unpacked clusters that are kept.
    pub cache_bytes: usize,
    /// Bytes of clusters that are kept as they are stored.
    pub stored_cache_bytes: usize,
    /// Bytes of texels that wait to be taken.
    pub ready_bytes: usize,
    /// Parcels that were asked for and have not been handed over.
    pub pending: usize,
}
