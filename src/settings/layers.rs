//! The sources of settings, and their precedence.
//!
//! Every value is checked alone, on top of the defaults, before the layers are merged. So an error names its source
//! and key, and never depends on another layer.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use serde_json::Value;

use super::Settings;
use crate::exit::bad_arguments;

/// Settings that have another name now: the earlier name and the present one.
const RENAMED: [(&str, &str); 1] = [("worker.recent_frames_mib", "worker.sources_mib")];

/// The configuration file in the current folder.
const FILE: &str = "argus.toml";
/// The environment variable that names another configuration file.
const FILE_VARIABLE: &str = "ARGUS_CONFIG";
/// Prefix of settings in the environment. Two underscores separate section and key, so that the variables that Kubernetes
/// sets for a service with a similar name (`ARGUS_COORDINATOR_PORT`) are not settings.
const PREFIX: &str = "ARGUS_";
/// Settings with an older variable of their own.
const ALIASES: [(&str, &str); 1] = [("ARGUS_SERVER", "client.server")];
/// Settings that are paths. In a file they are relative to its folder, elsewhere to the current one.
const PATHS: [&str; 11] = [
    "client.ca",
    "client.token_file",
    "client.certificate",
    "client.key",
    "coordinator.model",
    "coordinator.registry_credentials",
    "worker.scenes",
    "security.certificate",
    "security.key",
    "security.ca",
    "security.tokens",
];

/// Arguments of every subcommand that has settings.
#[derive(clap::Args, Debug, Clone, Default)]
#[command(next_help_heading = "Configuration")]
pub(crate) struct Sources {
    /// Configuration file, empty for none [default: ARGUS_CONFIG, else argus.toml if it exists]; see `argus config`
    #[arg(long, value_name = "FILE", global = true)]
    config: Option<OsString>,
    /// One setting, such as limits.views=100; may be given more than once; overrides the file and the environment
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", global = true)]
    settings: Vec<String>,
}

/// The source of a setting.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase", tag = "source", content = "from")]
pub(crate) enum Source {
    Default,
    File(PathBuf),
    Environment(String),
    Flag(String),
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::File(path) => write!(f, "{}", path.display()),
            Self::Environment(name) | Self::Flag(name) => f.write_str(name),
        }
    }
}

/// Settings that have flags of their own.
#[derive(Debug, Default)]
pub(crate) struct Flags(Vec<(&'static str, &'static str, String)>);

impl Flags {
    /// Adds a setting if its flag was given.
    pub(crate) fn with(
        mut self,
        key: &'static str,
        flag: &'static str,
        value: Option<impl ToString>,
    ) -> Self {
        self.0.extend(value.map(|value| (key, flag, value.to_string())));
        self
    }
}

/// A path as a flag's value.
pub(crate) fn path(path: Option<&PathBuf>) -> Option<String> {
    path.map(|path| path.display().to_string())
}

/// The settings in effect, merged from all sources.
#[derive(Debug)]
pub(crate) struct Effective {
    pub(crate) settings: Settings,
    /// The configuration file, if any.
    pub(crate) file: Option<PathBuf>,
    /// Key, value and source of each setting, in the order of the sections.
    pub(crate) values: Vec<(String, Value, Source)>,
}

impl Sources {
    /// Merges all layers.
    ///
    /// # Errors
    /// A file that cannot be read, or a setting that is unknown or invalid, with its source.
    pub(crate) fn load(&self, flags: Flags) -> anyhow::Result<Effective> {
        let mut layers = Layers::default();
        let file = self.file()?;
        if let Some(path) = &file {
            layers.add_file(path)?;
        }
        for (name, key, value) in variables() {
            let value = value.to_str().with_context(|| format!("{name} is not UTF-8"))?;
            // An empty variable, such as `${X:-}` in a compose file, sets nothing.
            if !value.is_empty() {
                layers.add_text(&key, value, Source::Environment(name))?;
            }
        }
        for setting in &self.settings {
            let Some((key, value)) = setting.split_once('=') else {
                return Err(bad_arguments(format!("--set {setting}: must be SECTION.KEY=VALUE")));
            };
            layers.add_flag(key.trim(), value, format!("--set {}", key.trim()))?;
        }
        for (key, flag, value) in flags.0 {
            layers.add_flag(key, &value, flag.to_owned())?;
        }
        layers.merge(file)
    }

    fn file(&self) -> anyhow::Result<Option<PathBuf>> {
        let variable = || std::env::var_os(FILE_VARIABLE).filter(|path| !path.is_empty());
        let path = match self.config.clone().or_else(variable) {
            Some(path) if path.is_empty() => return Ok(None),
            Some(path) => PathBuf::from(path),
            None if Path::new(FILE).is_file() => PathBuf::from(FILE),
            None => return Ok(None),
        };
        // An absolute path, so that a process in another folder finds the same file.
        std::path::absolute(&path).map(Some).with_context(|| format!("{}", path.display()))
    }
}

/// Name, setting and value of each environment variable that is a setting.
pub(crate) fn variables() -> impl Iterator<Item = (String, String, OsString)> {
    std::env::vars_os().filter_map(|(name, value)| {
        let name = name.into_string().ok()?;
        setting_of_variable(&name).map(|key| (name, key, value))
    })
}

/// Makes a setting's value absolute if it is a path.
fn located(key: &str, value: Value, source: &Source) -> Value {
    let (true, Value::String(path)) = (PATHS.contains(&key), &value) else { return value };
    let folder = match source {
        Source::File(file) => file.parent().unwrap_or(Path::new("")),
        _ => Path::new(""),
    };
    std::path::absolute(folder.join(path)).map_or(value, |path| path.display().to_string().into())
}

/// The setting of an environment variable.
fn setting_of_variable(name: &str) -> Option<String> {
    if let Some((_, key)) = ALIASES.into_iter().find(|(alias, _)| *alias == name) {
        return Some(key.to_owned());
    }
    let (section, key) = name.strip_prefix(PREFIX)?.split_once("__")?;
    Some(format!("{}.{}", section.to_lowercase(), key.to_lowercase()))
}

/// The merged layers so far. A later source overrides earlier ones.
struct Layers {
    defaults: Value,
    set: BTreeMap<String, (Value, Source)>,
}

impl Default for Layers {
    fn default() -> Self {
        let defaults = serde_json::to_value(Settings::default()).unwrap_or_default();
        Self { defaults, set: BTreeMap::new() }
    }
}

impl Layers {
    fn add_file(&mut self, path: &Path) -> anyhow::Result<()> {
        let at = path.display();
        let text = std::fs::read_to_string(path)
            .map_err(|e| bad_arguments(format!("the configuration {at} cannot be read: {e}")))?;
        let table: toml::Table = text.parse().map_err(|e: toml::de::Error| {
            bad_arguments(format!("the configuration {at} is not TOML: {}", e.to_string().trim_end()))
        })?;
        for (section, keys) in table {
            let toml::Value::Table(keys) = keys else {
                return Err(bad_arguments(format!("{at}: {section}: {}", self.unknown(&section))));
            };
            for (key, value) in keys {
                let key = format!("{section}.{key}");
                let value =
                    from_toml(value).map_err(|reason| bad_arguments(format!("{at}: {key}: {reason}")))?;
                self.add(&key, [value], Source::File(path.to_path_buf()))?;
            }
        }
        Ok(())
    }

    /// Adds a setting from a flag. An empty text removes the values of lower layers.
    fn add_flag(&mut self, key: &str, text: &str, flag: String) -> anyhow::Result<()> {
        if text.is_empty() {
            self.known(key).map_err(|reason| bad_arguments(format!("{flag}: {reason}")))?;
            self.set.remove(key);
            return Ok(());
        }
        self.add_text(key, text, Source::Flag(flag))
    }

    /// Adds a setting from text: as text, or else parsed as TOML.
    fn add_text(&mut self, key: &str, text: &str, source: Source) -> anyhow::Result<()> {
        let parsed = format!("value = {text}").parse::<toml::Table>().ok();
        let parsed = parsed.and_then(|mut table| from_toml(table.remove("value")?).ok());
        self.add(key, std::iter::once(Value::String(text.to_owned())).chain(parsed), source)
    }

    /// Adds the first value that the setting accepts.
    fn add(
        &mut self,
        key: &str,
        values: impl IntoIterator<Item = Value>,
        source: Source,
    ) -> anyhow::Result<()> {
        let mut fault = self.known(key).err();
        if fault.is_none() {
            for value in values.into_iter().map(|value| located(key, value, &source)) {
                match self.tried(key, value.clone()) {
                    Ok(()) => {
                        self.set.insert(key.to_owned(), (value, source));
                        return Ok(());
                    }
                    Err(reason) => fault = Some(reason),
                }
            }
        }
        let reason = fault.unwrap_or_default();
        Err(bad_arguments(match source {
            // The flag's name identifies the setting.
            Source::Flag(flag) => format!("{flag}: {reason}"),
            source => format!("{source}: {key}: {reason}"),
        }))
    }

    fn known(&self, key: &str) -> Result<(), String> {
        let known = key.split_once('.').and_then(|(section, key)| self.defaults.get(section)?.get(key));
        known.map(|_| ()).ok_or_else(|| self.unknown(key))
    }

    fn unknown(&self, key: &str) -> String {
        let names = |value: &Value| {
            let names: Vec<&str> =
                value.as_object().into_iter().flatten().map(|(name, _)| name.as_str()).collect();
            names.join(", ")
        };
        let section = key.split('.').next().unwrap_or_default();
        let renamed = RENAMED.iter().find(|(before, _)| *before == key);
        match (renamed, self.defaults.get(section)) {
            (Some((_, now)), _) => format!("the setting is now called {now}"),
            (None, Some(keys)) => {
                format!("there is no such setting; [{section}] has {}", names(keys))
            }
            (None, None) => format!("there is no such section; there are {}", names(&self.defaults)),
        }
    }

    /// Whether the setting accepts a value.
    fn tried(&self, key: &str, value: Value) -> Result<(), String> {
        let settings = self.with([(key, &value)])?;
        match settings.out_of_range() {
            Some((_, reason)) => Err(reason),
            None => Ok(()),
        }
    }

    fn with<'a>(&self, values: impl IntoIterator<Item = (&'a str, &'a Value)>) -> Result<Settings, String> {
        let mut tree = self.defaults.clone();
        for (key, value) in values {
            let place = key.split_once('.').and_then(|(section, key)| tree.get_mut(section)?.get_mut(key));
            *place.ok_or_else(|| self.unknown(key))? = value.clone();
        }
        serde_json::from_value(tree).map_err(|error| error.to_string())
    }

    fn merge(self, file: Option<PathBuf>) -> anyhow::Result<Effective> {
        let settings = self
            .with(self.set.iter().map(|(key, (value, _))| (key.as_str(), value)))
            .map_err(anyhow::Error::msg)?;
        let tree = serde_json::to_value(&settings)?;
        let mut values = Vec::new();
        for (section, keys) in tree.as_object().into_iter().flatten() {
            for (key, value) in keys.as_object().into_iter().flatten() {
                let key = format!("{section}.{key}");
                let source = self.set.get(&key).map_or(Source::Default, |(_, source)| source.clone());
                values.push((key, value.clone(), source));
            }
        }
        Ok(Effective { settings, file, values })
    }
}

/// Converts a value of a TOML file to JSON.
fn from_toml(value: toml::Value) -> Result<Value, String> {
    match value {
        toml::Value::Float(number) if !number.is_finite() => Err(format!("{number} is not finite")),
        value => serde_json::to_value(value).map_err(|error| error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(file: &str) -> anyhow::Result<Layers> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("argus.toml");
        std::fs::write(&path, file).unwrap();
        let mut layers = Layers::default();
        layers.add_file(&path).map(|()| layers)
    }

    fn reason(file: &str) -> String {
        layers(file).err().map(|error| error.to_string()).unwrap_or_default()
    }

    #[test]
    fn flags_override_the_environment_the_file_and_the_defaults_in_this_order() {
        let mut layers = layers("[limits]\nviews = 1\nsessions = 2\nview_side = 3\n").unwrap();
        let variable = |name: &str| Source::Environment(name.to_owned());
        layers.add_text("limits.sessions", "20", variable("ARGUS_LIMITS__SESSIONS")).unwrap();
        layers.add_text("limits.view_side", "30", variable("ARGUS_LIMITS__VIEW_SIDE")).unwrap();
        layers.add_flag("limits.view_side", "300", "--set limits.view_side".to_owned()).unwrap();
        let effective = layers.merge(None).unwrap();
        let limits = &effective.settings.limits;
        assert_eq!((limits.views, limits.sessions, limits.view_side), (1, 20, 300));
        assert_eq!(limits.connections, super::super::Limits::default().connections);
        let source_of = |key: &str| {
            effective.values.iter().find(|(name, ..)| name == key).map(|(_, _, source)| source.clone())
        };
        assert!(
            matches!(source_of("limits.views"), Some(Source::File(path)) if path.ends_with("argus.toml"))
        );
        assert_eq!(source_of("limits.sessions"), Some(variable("ARGUS_LIMITS__SESSIONS")));
        assert_eq!(source_of("limits.view_side"), Some(Source::Flag("--set limits.view_side".to_owned())));
        assert_eq!(source_of("limits.connections"), Some(Source::Default));
    }

    #[test]
    fn unknown_and_invalid_settings_are_rejected_with_their_source() {
        let unknown = reason("[limits]\nveiws = 1\n");
        assert!(unknown.contains("argus.toml: limits.veiws: there is no such setting"), "{unknown}");
        assert!(unknown.contains("views_per_client"), "{unknown}");
        let renamed = reason("[worker]\nrecent_frames_mib = 1\n");
        assert!(renamed.contains("the setting is now called worker.sources_mib"), "{renamed}");
        let section = reason("[limit]\nviews = 1\n");
        assert!(section.contains("no such section") && section.contains("security"), "{section}");
        assert!(reason("views = 1\n").contains("no such section"));
        assert!(reason("[limits\n").contains("is not TOML"));
        let kind = reason("[limits]\nviews = \"many\"\n");
        assert!(kind.contains("argus.toml: limits.views: invalid type"), "{kind}");
        for out_of_range in [
            "[coordinator]\nrefining_share = 1.5",
            "[coordinator]\nepoch_ms = 0",
            "[limits]\nviews = 0",
            "[limits]\nwait_secs = -1",
            "[limits]\npixels_per_sec = nan",
            "[limits]\npixels_per_sec = 0",
            "[coordinator]\nlease_secs = inf",
            "[coordinator]\nregistry = \"nats://argus:secret@host\"",
        ] {
            assert!(
                reason(out_of_range).contains("argus.toml: "),
                "{out_of_range}: {}",
                reason(out_of_range)
            );
        }
    }

    #[test]
    fn texts_are_parsed_as_the_settings_type() {
        let mut layers = Layers::default();
        for (key, text) in [
            ("client.server", "http://10.0.0.1:7400"),
            ("worker.coordinator", "123"),
            ("security.insecure", "true"),
            ("limits.pixels_per_sec", "1e6"),
            ("coordinator.time_scale", "2"),
        ] {
            layers.add_text(key, text, Source::Default).unwrap();
        }
        let settings = layers.merge(None).unwrap().settings;
        assert_eq!(settings.worker.coordinator.as_deref(), Some("123"));
        assert!(settings.security.insecure);
        assert_eq!(settings.limits.pixels_per_sec, Some(1e6));
        assert_eq!(settings.coordinator.time_scale, 2.0);
        let wrong = Layers::default().add_text("limits.views", "-1", Source::Environment("X".to_owned()));
        assert!(wrong.unwrap_err().to_string().starts_with("X: limits.views: "));
    }

    #[test]
    fn an_empty_flag_removes_the_values_of_lower_layers() {
        let mut layers = layers("[worker]\nadvertise = \"http://a:1\"\n").unwrap();
        layers.add_flag("worker.advertise", "", "--set worker.advertise".to_owned()).unwrap();
        assert_eq!(layers.merge(None).unwrap().settings.worker.advertise, None);
        assert!(Layers::default().add_flag("worker.advertize", "", "--set".to_owned()).is_err());
    }

    #[test]
    fn paths_in_a_file_are_relative_to_its_folder() {
        let layers = layers("[security]\nca = \"certs/ca.pem\"\nkey = \"/etc/argus/key.pem\"\n").unwrap();
        let security = layers.merge(None).unwrap().settings.security;
        assert!(security.ca.as_ref().is_some_and(|ca| ca.is_absolute() && ca.ends_with("certs/ca.pem")));
        assert_eq!(security.key, Some(PathBuf::from("/etc/argus/key.pem")));
    }

    #[test]
    fn a_file_for_another_process_is_private_and_has_the_same_settings() {
        let mut layers =
            layers("[limits]\npixels_per_sec = 1e6\n[worker]\nlisten = \"a \\\"b\\\"\"\n").unwrap();
        layers.add_flag("security.ca", "certs/ca.pem", "--ca".to_owned()).unwrap();
        let settings = layers.merge(None).unwrap().settings;
        let file = settings.to_file().unwrap();
        let mut again = Layers::default();
        again.add_file(file.path()).unwrap();
        assert_eq!(again.merge(None).unwrap().settings, settings);
        #[cfg(unix)]
        assert_eq!(std::os::unix::fs::MetadataExt::mode(&file.path().metadata().unwrap()) & 0o077, 0);
    }

    #[test]
    fn only_variables_with_two_underscores_are_settings() {
        assert_eq!(setting_of_variable("ARGUS_LIMITS__VIEWS").as_deref(), Some("limits.views"));
        assert_eq!(setting_of_variable("ARGUS_SERVER").as_deref(), Some("client.server"));
        for other in ["ARGUS_COORDINATOR_PORT", "ARGUS_SCENES", "LIMITS__VIEWS", "PATH"] {
            assert_eq!(setting_of_variable(other), None, "{other}");
        }
    }

    #[test]
    fn every_path_is_a_setting_that_may_be_unset() {
        let layers = Layers::default();
        for key in PATHS {
            assert_eq!(layers.known(key), Ok(()), "{key}");
            assert_eq!(layers.tried(key, Value::Null), Ok(()), "{key}");
        }
    }

    #[test]
    fn the_documented_file_has_every_setting_at_its_default() {
        let documented = include_str!("../../docs/argus.toml");
        // Settings without a value are documented behind a `#`.
        let uncommented: String = documented
            .lines()
            .map(|line| match line.strip_prefix('#') {
                Some(rest) if rest.contains(" = ") && !rest.starts_with(' ') => format!("{rest}\n"),
                _ => format!("{line}\n"),
            })
            .collect();
        let table: toml::Table = uncommented.parse().unwrap();
        let layers = Layers::default();
        let mut documented_keys = Vec::new();
        for (section, keys) in &table {
            for (key, value) in keys.as_table().unwrap() {
                let default = &layers.defaults[section.as_str()][key.as_str()];
                let value = from_toml(value.clone()).unwrap();
                let same = *default == value || default.as_f64().is_some_and(|d| value.as_f64() == Some(d));
                assert!(default.is_null() || same, "{section}.{key}: {value}, the default is {default}");
                documented_keys.push(format!("{section}.{key}"));
            }
        }
        let all = layers.merge(None).unwrap().values;
        let mut all: Vec<String> = all.into_iter().map(|(key, ..)| key).collect();
        documented_keys.sort();
        all.sort();
        assert_eq!(documented_keys, all);
    }
}
