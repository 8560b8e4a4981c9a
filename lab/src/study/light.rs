//! `argus-lab study light`: what light costs, and its error.

use argus_studies::light::{effects, equal_error, indirect, shadows};

use super::run::{Named, Run, blocking};

#[derive(clap::Subcommand)]
pub(super) enum Study {
    Indirect(indirect::Options),
    Shadows(shadows::Options),
    Effects(effects::Options),
    EqualError(equal_error::Options),
}

impl Study {
    pub(super) async fn run(self, run: &Run<'_>) -> anyhow::Result<Named> {
        let progress = run.progress;
        Ok(match self {
            Self::Indirect(options) => ("indirect", blocking(options, progress, indirect::run).await?),
            Self::Shadows(options) => ("shadows", blocking(options, progress, shadows::run).await?),
            Self::Effects(options) => {
                let options = effects::Options { pictures: run.form.out.clone(), ..options };
                ("effects", blocking(options, progress, effects::run).await?)
            }
            Self::EqualError(options) => {
                ("equal-error", blocking(options, progress, equal_error::run).await?)
            }
        })
    }
}
