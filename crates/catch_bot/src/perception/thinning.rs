//! Thinning: fewer points and rays where there are more than help.

/// Points of an image that are kept, and rays of its silhouette, about. An object that passes a camera
/// closely fills its image: all of its pixels would take ten times as long, and most of their errors are
/// common ones.
pub(super) const KEPT_OF_IMAGE: usize = 512;

/// Every which of `count` is taken over to be left with about `most`.
pub(super) fn stride(count: usize, most: usize) -> usize {
    count.div_ceil(most.max(1)).max(1)
}

/// Returns whether item `number` of a list is one of about `most` that are kept of `count` in a row, spread
/// evenly: fractions of multiples of the golden ratio repeat in no row of an image as a stride may.
pub(super) fn is_kept(number: usize, count: usize, most: usize) -> bool {
    /// The fraction of the golden ratio, in units of 2⁻³².
    const GOLDEN: u32 = 0x9E37_79B9;
    let limit = ((most as u64) << 32) / count.max(1) as u64;
    count <= most || u64::from((number as u32).wrapping_mul(GOLDEN)) < limit
}

/// Leaves about `most` of the items from `first` on where there are more, spread evenly.
pub(super) fn thin<T>(items: &mut Vec<T>, first: usize, most: usize) {
    let (count, mut number) = (items.len() - first, 0);
    items.retain(|_| {
        number += 1;
        number <= first || is_kept(number, count, most)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_spread_evenly_and_what_came_before_stays() {
        for count in [3, 512, 513, 5_000, 100_000] {
            let mut items: Vec<usize> = (0..100 + count).collect();
            thin(&mut items, 100, 512);
            assert!((0..100).eq(items[..100].iter().copied()));
            let left = &items[100..];
            assert!(left.len().abs_diff(count.min(512)) < 4, "{count}: {}", left.len());
            let widest = left.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
            assert!(widest <= 3 * count.div_ceil(512), "{count}: {widest}");
        }
    }
}
