//! Samples of some faces, and samples that are extended by faces.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;

use argus_gpu::plane;
use argus_scene::{
    Cancel, FaceMask, Plane, PlaneData, RenderError, Sample, SampleJob, Sampler as _, Visibility,
};

use crate::common::*;
use crate::small_scene;

/// Texels on a side of a face.
const FACE: u32 = 48;

fn mask(bits: u32) -> FaceMask {
    FaceMask::new(bits, "faces").unwrap()
}

/// The order for some faces of a sample.
fn of_faces(job: &SampleJob, faces: FaceMask) -> SampleJob {
    SampleJob { faces: [(job.ids[0].camera, faces)].into_iter().collect(), ..job.clone() }
}

fn job(visibility: Visibility, to_host: bool) -> (Arc<argus_scene::Scene>, SampleJob) {
    let scene = Arc::new(small_scene::scene());
    let job = job_around_origin(&scene, FACE);
    let info = argus_scene::SampleSetInfo { visibility, ..(*job.info).clone() };
    let job = SampleJob { info: Arc::new(info), to_host, ..job };
    (scene, job)
}

/// The bytes of a plane, wherever it is.
fn bytes_of(plane: &Plane) -> Vec<u8> {
    match plane::to_host(&gpu(), plane).unwrap().data {
        PlaneData::Host(bytes) => bytes.to_vec(),
        PlaneData::Device(_) => panic!("it was read back"),
    }
}

/// The texels of one face of a plane, whose faces have so many on a side.
pub(crate) fn face_of(plane: &Plane, side: u32, face: usize) -> Vec<u8> {
    let texel = plane.format.texel_bytes();
    let (bytes, row, side) = (bytes_of(plane), plane.size[0] as usize * texel, side as usize);
    let (x, y) = (face % 3 * side, face / 3 * side);
    let row_of = |y: usize| bytes[y * row + x * texel..][..side * texel].to_vec();
    (y..y + side).flat_map(row_of).collect()
}

pub(crate) fn assert_equal(one: &Sample, other: &Sample) {
    assert_eq!((one.faces, one.planes.len()), (other.faces, other.planes.len()));
    for (a, b) in one.planes.iter().zip(&other.planes) {
        assert_eq!((a.kind, a.format, a.size), (b.kind, b.format, b.size));
        assert!(bytes_of(a) == bytes_of(b), "{:?}", a.kind);
    }
}

#[test]
fn a_sample_of_some_faces_has_the_bytes_of_the_whole_one_there() {
    for visibility in [Visibility::Raster, Visibility::Cpu] {
        for to_host in [true, false] {
            let (scene, job) = job(visibility, to_host);
            let mut sampler = sampler(&scene);
            let whole = sample(&mut sampler, &job);
            assert_eq!((whole.faces, whole.planes.len()), (FaceMask::ALL, 4), "the scene is glossy");
            for bits in [0b1, 0b10_1000, 0b01_1110] {
                let some = sample(&mut sampler, &of_faces(&job, mask(bits)));
                assert_eq!(some.faces, mask(bits));
                for (a, b) in some.planes.iter().zip(&whole.planes) {
                    for face in 0..6 {
                        let bytes = face_of(a, FACE, face);
                        match mask(bits).has(face) {
                            true => {
                                assert!(bytes == face_of(b, FACE, face), "{visibility:?} {:?} {face}", a.kind)
                            }
                            false => assert!(bytes.iter().all(|byte| *byte == 0), "{:?} {face}", a.kind),
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn an_extended_sample_equals_one_rendered_at_once() {
    let (scene, to_host) = job(Visibility::Cpu, true);
    let to_device = SampleJob { to_host: false, ..to_host.clone() };
    let mut sampler = sampler(&scene);
    for (before, after) in [(&to_host, &to_host), (&to_device, &to_device), (&to_device, &to_host)] {
        let some = sample(&mut sampler, &of_faces(before, mask(0b10_0001)));
        let extended = vec![Arc::new(some)];
        // Two more faces; those that are there already need not be asked for.
        let wanted = SampleJob { extended: extended.clone(), ..of_faces(after, mask(0b01_0010)) };
        let more = sample(&mut sampler, &wanted);
        assert_equal(&more, &sample(&mut sampler, &of_faces(after, mask(0b11_0011))));
        let all = sample(&mut sampler, &SampleJob { extended: vec![Arc::new(more)], ..after.clone() });
        assert_equal(&all, &sample(&mut sampler, after));
    }
}

#[test]
fn a_sample_of_other_planes_is_not_extended() {
    let (scene, job) = job(Visibility::Cpu, true);
    let mut sampler = sampler(&scene);
    let mut some = sample(&mut sampler, &of_faces(&job, mask(1)));
    some.planes.pop();
    let job = specified(&sampler, &SampleJob { extended: vec![Arc::new(some)], ..job });
    match sampler.render_samples(&job, &Cancel::new()).remove(0) {
        Err(RenderError::Invalid(refused)) => assert_eq!(refused.field, "extended.planes"),
        other => panic!("must be refused: {:?}", other.map(|sample| sample.faces)),
    }
}
