//! Flags that this process passes on to another one, as they were typed.

use std::marker::PhantomData;

use clap::parser::ValueSource;
use clap::{ArgMatches, Command, FromArgMatches};

/// Flags of `T` that this process passes on to another one.
#[derive(Debug, Clone)]
pub struct PassedOn<T> {
    /// The flags as they were given.
    pub arguments: Vec<String>,
    flags: PhantomData<T>,
}

impl<T: clap::Args> FromArgMatches for PassedOn<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut arguments = Vec::new();
        for flag in T::augment_args(Command::default()).get_arguments() {
            let id = flag.get_id().as_str();
            let given = matches.value_source(id) == Some(ValueSource::CommandLine);
            let values = given.then(|| matches.get_raw(id)).flatten().into_iter().flatten();
            let name = flag.get_long().unwrap_or_default();
            arguments.extend(values.map(|value| format!("--{name}={}", value.display())));
        }
        Ok(Self { arguments, flags: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<T: clap::Args> clap::Args for PassedOn<T> {
    fn augment_args(command: Command) -> Command {
        T::augment_args(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        T::augment_args_for_update(command)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Samples;
    use super::*;

    #[test]
    fn flags_are_passed_on_as_they_were_given() {
        #[derive(clap::Parser)]
        struct Program {
            #[command(flatten)]
            samples: PassedOn<Samples>,
        }
        let passed = |flags: &[&str]| {
            let words = ["program"].iter().chain(flags);
            <Program as clap::Parser>::try_parse_from(words).map(|program| program.samples.arguments)
        };
        let all = ["--rig=cell", "--tiles=4X2", "--cell=0.50", "--sampling=megaviews", "--particles=9"];
        assert_eq!(passed(&all).unwrap(), all);
        assert_eq!(passed(&["--sub-samples", "16"]).unwrap(), ["--sub-samples=16"]);
        assert_eq!(passed(&["--effects", "shadows,emitters"]).unwrap(), ["--effects=shadows,emitters"]);
        assert!(passed(&["--effects", "shadow"]).is_err_and(|error| error.to_string().contains("`shadow`")));
        assert!(passed(&[]).unwrap().is_empty());
        assert!(passed(&["--rig", "sphere"]).is_err());
    }
}
