//! JSON objects of a document that the `gltf` crate's types lack.

use serde_json::Value;

/// A JSON value that is read leniently: what is missing or of another kind counts as absent.
#[derive(Clone, Copy)]
pub(super) struct Object<'a>(Option<&'a Value>);

impl<'a> Object<'a> {
    pub(super) fn new(value: Option<&'a Value>) -> Self {
        Self(value)
    }

    pub(super) fn exists(self) -> bool {
        self.0.is_some()
    }

    pub(super) fn get(self, key: &str) -> Self {
        Self(self.0.and_then(|value| value.get(key)))
    }

    pub(super) fn extension(self, name: &str) -> Self {
        self.get("extensions").get(name)
    }

    /// A number; NaN and infinities cannot be written in JSON, but overflow to infinity.
    pub(super) fn number(self, key: &str, default: f32) -> f32 {
        self.get(key).0.and_then(Value::as_f64).map_or(default, |number| number as f32)
    }

    pub(super) fn numbers<const N: usize>(self, key: &str, default: [f32; N]) -> [f32; N] {
        let Some(list) = self.get(key).0.and_then(Value::as_array).filter(|list| list.len() == N) else {
            return default;
        };
        std::array::from_fn(|i| list[i].as_f64().map_or(default[i], |number| number as f32))
    }

    pub(super) fn index(self, key: &str) -> Option<usize> {
        usize::try_from(self.get(key).0?.as_u64()?).ok()
    }

    pub(super) fn text(self, key: &str) -> &'a str {
        self.get(key).0.and_then(Value::as_str).unwrap_or_default()
    }

    pub(super) fn is_true(self, key: &str) -> bool {
        self.get(key).0.and_then(Value::as_bool).unwrap_or(false)
    }
}
