//! Packed images.

use argus_proto::codec::{Layout, pack, unpack};

const LAYOUTS: [Layout; 7] =
    [Layout::R8, Layout::Rgb8, Layout::Rgba8, Layout::Rg16, Layout::Rgba16, Layout::R32, Layout::Rgb9e5];

/// Texels of the corpus's images: a multiple of every layout's texel.
const BYTES: usize = 4800;

/// One packed image for each layout.
pub fn corpus() -> Vec<Vec<u8>> {
    let smooth: Vec<u8> = (0..BYTES).map(|i| (i / 24) as u8).collect();
    let one = |(index, layout): (usize, &Layout)| {
        let packed = pack(*layout, &smooth).ok().flatten().unwrap_or_default();
        std::iter::once(index as u8).chain(packed).collect()
    };
    LAYOUTS.iter().enumerate().map(one).collect()
}

/// Unpacks an image, packs its bytes again, and checks that unpacking gives the same bytes.
pub fn roundtrip(bytes: &[u8]) -> Result<(), String> {
    let Some((&first, rest)) = bytes.split_first() else { return Err("nothing".to_owned()) };
    let layout = LAYOUTS[usize::from(first) % LAYOUTS.len()];
    let whole = rest.len() - rest.len() % layout.texel_bytes();
    if let Some(packed) = pack(layout, &rest[..whole]).map_err(|e| e.to_string())? {
        let back = unpack(layout, &packed, whole).map_err(|e| e.to_string());
        assert_eq!(back.as_deref(), Ok(&rest[..whole]), "{layout:?}");
    }
    let unpacked = unpack(layout, rest, BYTES).map_err(|e| e.to_string())?;
    assert_eq!(unpacked.len(), BYTES);
    Ok(())
}
