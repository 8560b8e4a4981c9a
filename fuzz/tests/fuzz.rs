//! Every target with its corpus and, briefly, with random edits of it.
//!
//! An input that takes disproportionate memory or time fails like a panic.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::alloc::{GlobalAlloc, Layout, System};
use std::backtrace::Backtrace;
use std::collections::BTreeSet;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use argus_fuzz::{Edit, cells, chunks, edited, files, images, messages, sessions};
use bolero::check;
use prost::Message;

/// Largest block of memory: the 64 MiB that an image may take whatever its length, and 1100 times its length, for
/// inputs of up to 8 KiB.
const LARGEST_BLOCK: usize = (64 << 20) + 1100 * (8 << 10);
/// Longest time for an input, on a busy machine.
const LONGEST: Duration = Duration::from_secs(10);
/// Inputs of a target in a test run, unless BOLERO_RANDOM_ITERATIONS or BOLERO_RANDOM_TEST_TIME_MS says otherwise.
const ITERATIONS: usize = 10_000;

/// An allocator that notes the largest block of any thread, since loaders use their own threads.
struct Noting;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: the system's allocator does all of the work.
unsafe impl GlobalAlloc for Noting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(block, layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(size);
        // SAFETY: as the caller promised.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.alloc_zeroed(layout) }
    }
}

/// Where the first block that is too large was asked for.
static ASKED_FROM: OnceLock<Backtrace> = OnceLock::new();

fn note(size: usize) {
    if LARGEST.fetch_max(size, Ordering::Relaxed) <= LARGEST_BLOCK && size > LARGEST_BLOCK {
        // Blocks of the backtrace itself come here as well, but are no larger.
        let _ = ASKED_FROM.set(Backtrace::force_capture());
    }
}

#[global_allocator]
static ALLOCATOR: Noting = Noting;

/// Runs a target within its bounds.
fn bounded(run: impl FnOnce() -> Result<(), String>) -> Result<(), String> {
    let began = Instant::now();
    let result = run();
    let largest = LARGEST.load(Ordering::Relaxed);
    // Targets that run at the same time share the largest block, and fail together.
    assert!(
        largest <= LARGEST_BLOCK,
        "a block of {} MiB: {}",
        largest >> 20,
        ASKED_FROM.get().map_or_else(String::new, Backtrace::to_string)
    );
    assert!(began.elapsed() <= LONGEST, "it took {:?}", began.elapsed());
    result
}

/// Number of inputs; unlimited if a time is set.
fn iterations() -> usize {
    if std::env::var_os("BOLERO_RANDOM_TEST_TIME_MS").is_some() { usize::MAX } else { ITERATIONS }
}

/// Indices of a valid input and of a source of pieces, and the edits.
type Input = (u8, u8, Vec<Edit>);

/// Checks that the corpus passes, and that no edit of it makes the target fail.
fn fuzz(corpus: &[Vec<u8>], target: impl Fn(usize, &[u8]) -> Result<(), String> + std::panic::RefUnwindSafe) {
    for (index, bytes) in corpus.iter().enumerate() {
        let result = bounded(|| target(index, bytes));
        assert_eq!(result, Ok(()), "input {index} of the corpus is not valid");
    }
    let (inputs, taken) = (AtomicUsize::new(0), AtomicUsize::new(0));
    check!().with_type::<Input>().with_iterations(iterations()).for_each(|(seed, other, edits)| {
        let index = usize::from(*seed) % corpus.len();
        let bytes = edited(&corpus[index], &corpus[usize::from(*other) % corpus.len()], edits);
        // The target may accept or refuse it.
        let result = bounded(|| target(index, &bytes));
        inputs.fetch_add(1, Ordering::Relaxed);
        taken.fetch_add(result.is_ok().into(), Ordering::Relaxed);
    });
    let (inputs, taken) = (inputs.into_inner(), taken.into_inner());
    eprintln!("{inputs} inputs, {taken} of them taken");
    // If all inputs are refused, the edits leave only noise. Loaders with warnings may accept all.
    assert!(inputs < 1000 || taken > inputs / 100, "{taken} of {inputs} inputs were taken");
}

#[test]
fn every_message() {
    let corpus = messages::corpus();
    let (kinds, bytes): (Vec<usize>, Vec<Vec<u8>>) = corpus.into_iter().unzip();
    fuzz(&bytes, move |index, bytes| {
        let (_, take) = messages::ALL[kinds[index]];
        take(bytes)
    });
}

#[test]
fn messages_as_each_other() {
    // Fields of one message are read as those of another: messages without a corpus get further than with noise.
    let corpus: Vec<Vec<u8>> = messages::corpus().into_iter().map(|(_, bytes)| bytes).collect();
    check!().with_type::<(u8, Input)>().with_iterations(iterations()).for_each(
        |(kind, (seed, other, edits))| {
            let (_, take) = messages::ALL[usize::from(*kind) % messages::ALL.len()];
            let at = |place: &u8| &corpus[usize::from(*place) % corpus.len()][..];
            let bytes = edited(at(seed), at(other), edits);
            let _ = bounded(|| take(&bytes));
        },
    );
}

#[test]
fn no_message_is_left_out() {
    let descriptors = prost_types::FileDescriptorSet::decode(argus_proto::FILE_DESCRIPTOR_SET).unwrap();
    let ours = descriptors.file.iter().filter(|file| file.package() == "argus.v1");
    let defined: BTreeSet<&str> =
        ours.flat_map(|file| &file.message_type).map(|message| message.name()).collect();
    let fuzzed: BTreeSet<&str> = messages::ALL.iter().map(|(name, _)| *name).collect();
    assert_eq!(fuzzed, defined);
}

#[test]
fn no_request_of_a_client_can_name_a_file() {
    let descriptors = prost_types::FileDescriptorSet::decode(argus_proto::FILE_DESCRIPTOR_SET).unwrap();
    let messages = || descriptors.file.iter().flat_map(|file| &file.message_type);
    let mut waiting = vec!["DescribeRequest", "RenderRequest", "SessionRequest", "StatusRequest"];
    let (mut seen, mut texts) = (BTreeSet::new(), BTreeSet::new());
    while let Some(name) = waiting.pop() {
        let message = messages().find(|message| message.name() == name).unwrap();
        if !seen.insert(name) {
            continue;
        }
        for field in &message.field {
            use prost_types::field_descriptor_proto::Type;
            match field.r#type() {
                Type::String => drop(texts.insert(format!("{name}.{}", field.name()))),
                Type::Message => waiting.push(field.type_name().rsplit('.').next().unwrap()),
                _ => {}
            }
        }
    }
    // Texts for logs and traces, the device of a pin, and texts only of a coordinator (refused from clients,
    // see `order`).
    let harmless = [
        "Provenance.device",
        "RenderRequest.view_id",
        "SampleSource.addresses",
        "SessionMissed.reason",
        "SessionView.traceparent",
        "ViewOrder.history",
        "ViewOrder.tracers",
    ];
    assert_eq!(texts.iter().map(String::as_str).collect::<Vec<_>>(), harmless);
}

#[test]
fn frames() {
    fuzz(&chunks::frames_corpus(), |_, bytes| chunks::frames(bytes));
}

#[test]
fn tickets() {
    fuzz(&sessions::tickets_corpus(), |_, bytes| sessions::tickets(bytes));
}

#[test]
fn session_words() {
    fuzz(&sessions::words_corpus(), |_, bytes| sessions::words(bytes));
}

#[test]
fn samples() {
    fuzz(&chunks::samples_corpus(), |_, bytes| chunks::samples(bytes));
}

#[test]
fn traces() {
    fuzz(&chunks::traces_corpus(), |_, bytes| chunks::traces(bytes));
}

#[test]
fn pixels() {
    fuzz(&chunks::pixels_corpus(), |_, bytes| chunks::pixels(bytes));
}

#[test]
fn scenes() {
    fuzz(&chunks::scenes_corpus(), |_, bytes| chunks::scenes(bytes));
}

#[test]
fn light_cells() {
    fuzz(&cells::corpus(), |_, bytes| cells::page(bytes));
}

#[test]
fn packed_images() {
    fuzz(&images::corpus(), |_, bytes| images::roundtrip(bytes));
}

/// Fuzzes the files of one format.
fn loader(names: &[&str]) {
    let files: Vec<(&str, Vec<u8>)> =
        files::corpus().into_iter().filter(|(name, _)| names.contains(name)).collect();
    let (names, bytes): (Vec<&str>, Vec<Vec<u8>>) = files.into_iter().unzip();
    fuzz(&bytes, move |index, bytes| files::load(names[index], bytes));
}

#[test]
fn obj_files() {
    loader(&["scene.obj", "faces.obj"]);
}

#[test]
fn mtl_files() {
    loader(&["scene.mtl"]);
}

#[test]
fn ply_files() {
    loader(&["ascii.ply", "binary.ply", "big-endian.ply"]);
}

#[test]
fn gltf_files() {
    loader(&["scene.gltf", "scene.glb", "triangle.glb"]);
}

#[test]
fn a_texture_of_a_few_bytes_never_takes_gigabytes() {
    let (_, mut png) = files::corpus().into_iter().find(|(name, _)| *name == "checker.png").unwrap();
    for side in [20_000_u32, 0x7fff_ffff] {
        // Width and height are at the beginning of the first chunk.
        png[16..20].copy_from_slice(&side.to_be_bytes());
        png[20..24].copy_from_slice(&side.to_be_bytes());
        // A texture that cannot be decoded is a warning: the scene loads without it.
        assert_eq!(bounded(|| files::load("checker.png", &png)), Ok(()));
    }
}

#[test]
fn environments() {
    fuzz(&files::environments(), |_, bytes| files::environment(bytes));
}

#[test]
fn textures() {
    loader(&["checker.png", "checker.jpg", "checker.bmp", "checker.tga", "checker.gif"]);
}

#[test]
fn textures_of_other_encoders() {
    loader(&["palette.png", "cmyk.jpg", "progressive.jpg", "checker.webp", "lossy.webp"]);
}

#[test]
fn ktx2_textures() {
    loader(&["etc1s.ktx2", "etc1s-alpha.ktx2", "uastc.ktx2", "astc.ktx2"]);
}

#[test]
fn compressed_meshes() {
    loader(&["cube.drc", "packed.bin"]);
}
