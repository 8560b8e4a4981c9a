//! References: views from triangles that others are judged against, rendered by the service and kept in a folder.

use std::path::PathBuf;

use anyhow::{Context, bail};
use argus_client::load::{burst, patient};
use argus_client::{Answer, Client};
use argus_scene::View;
use image::RgbImage;

use crate::output::{image_of, read_rgb, write_rgb_png};

/// References in work at once. Nothing is timed.
const IN_FLIGHT: usize = 4;

/// Renders references, or finds those of an earlier run in a folder.
pub(crate) struct References {
    folder: Option<PathBuf>,
}

impl References {
    /// References that are kept in a folder, if one is given.
    pub(crate) fn new(folder: Option<PathBuf>) -> Self {
        Self { folder }
    }

    /// The images of views that pin their provenance, in their order.
    ///
    /// # Errors
    /// A view is not answered, or the folder cannot be used.
    pub(crate) async fn images(&self, client: &Client, views: &[View]) -> anyhow::Result<Vec<RgbImage>> {
        let mut images: Vec<Option<RgbImage>> = Vec::with_capacity(views.len());
        for view in views {
            images.push(match self.path(view)?.filter(|path| path.exists()) {
                Some(path) => Some(read_rgb(&path)?),
                None => None,
            });
        }
        let missing: Vec<usize> = (0..views.len()).filter(|i| images[*i].is_none()).collect();
        let asked = missing.iter().map(|i| views[*i].clone()).collect();
        let (mut failed, patient) = (None, patient());
        let outcome = burst(client, asked, IN_FLIGHT, &patient, |i, answer: Answer| {
            match image_of(&answer.frame)
                .and_then(|image| self.keep(&views[missing[i]], &image).map(|()| image))
            {
                Ok(image) => images[missing[i]] = Some(image),
                Err(error) => failed = Some(error),
            }
        });
        let outcome = outcome.await;
        if let Some(error) = outcome.first_error {
            bail!("{} of {} references were not answered: {error}", outcome.failed, outcome.views);
        }
        failed.map_or(Ok(()), Err)?;
        images.into_iter().collect::<Option<_>>().context("a reference is missing")
    }

    /// The file of a view's image. Its name is a hash of all that the image is a function of, but the device.
    fn path(&self, view: &View) -> anyhow::Result<Option<PathBuf>> {
        let Some(folder) = &self.folder else { return Ok(None) };
        let pin = view.pin.as_ref().context("a reference pins its provenance")?;
        let scene = pin.scene.to_string();
        let made_by = (&pin.state, &pin.plan, &pin.specification);
        let text = serde_json::to_string(&(&scene, view.camera, view.width, view.height, made_by))?;
        let name = blake3::hash(text.as_bytes()).to_hex();
        let scene: String = scene.chars().take(16).collect();
        Ok(Some(folder.join(scene).join(format!("{}.png", &name[..32]))))
    }

    fn keep(&self, view: &View, image: &RgbImage) -> anyhow::Result<()> {
        match self.path(view)? {
            // Written beside it and renamed, so that an interrupted run leaves no half image.
            Some(path) => {
                let partial = path.with_extension(format!("{}.part", std::process::id()));
                write_rgb_png(&partial, image.width(), image.height(), image)?;
                std::fs::rename(&partial, &path).with_context(|| format!("cannot write {}", path.display()))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, Plan, PlanRequest, Provenance, SceneHash, SceneState};
    use glam::DVec3;

    use super::*;

    fn view(x: f64, samples: u32, epoch: u64) -> View {
        let camera = Camera::look_at(DVec3::new(x, 1.0, 2.0), DVec3::ZERO);
        let state = SceneState::of_epoch(epoch);
        let pin = Provenance::of_plan(SceneHash([7; 32]), state, Plan::direct(samples));
        View { pin: Some(pin), ..View::new(camera, [4, 3], PlanRequest::default()) }
    }

    #[test]
    fn a_kept_reference_is_found_again_and_only_for_the_same_view() {
        let folder = tempfile::tempdir().unwrap();
        let references = References::new(Some(folder.path().to_owned()));
        let image = RgbImage::from_fn(4, 3, |x, y| image::Rgb([x as u8, y as u8, 77]));
        references.keep(&view(1.0, 16, 0), &image).unwrap();
        let path = references.path(&view(1.0, 16, 0)).unwrap().unwrap();
        assert_eq!(read_rgb(&path).unwrap(), image);
        for other in [view(1.0 + f64::EPSILON, 16, 0), view(1.0, 1, 0), view(1.0, 16, 1)] {
            assert!(!references.path(&other).unwrap().unwrap().exists());
        }
        assert!(References::new(None).path(&view(1.0, 16, 0)).unwrap().is_none());
    }
}
