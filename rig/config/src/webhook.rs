//! The address that alerts are posted to.

use http::Uri;
use serde::{Deserialize, Serialize};

/// An address, of which all but the host may be a secret: what is written of it, in a run's `start.json`, ends with the host.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct Webhook {
    url: String,
    read: Option<Uri>,
}

impl Webhook {
    /// The whole of it.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Its host, which may be told.
    pub fn host(&self) -> Option<&str> {
        self.read.as_ref().and_then(Uri::host)
    }

    /// Whether something can be posted to it; the refusal tells nothing of it, for it goes into journals.
    ///
    /// # Errors
    /// What is wanted.
    pub(super) fn check(&self) -> Result<(), &'static str> {
        let is_known = |scheme: &str| ["http", "https"].contains(&scheme);
        match &self.read {
            Some(url) if url.host().is_some() && url.scheme_str().is_some_and(is_known) => Ok(()),
            _ => Err("[alerts] webhook is no address of the form https://host/path"),
        }
    }
}

impl std::fmt::Debug for Webhook {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Webhook").field(&self.host()).finish()
    }
}

impl From<String> for Webhook {
    fn from(url: String) -> Self {
        Self { read: url.parse().ok(), url }
    }
}

impl From<Webhook> for String {
    fn from(webhook: Webhook) -> Self {
        let scheme = webhook.read.as_ref().and_then(Uri::scheme_str).unwrap_or("https");
        format!("{scheme}://{}/", webhook.host().unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn webhook_that_is_no_address_is_refused_without_being_told() {
        for url in ["https://example.org/hook", "http://user:pass@10.0.0.1:8080/?key=1"] {
            Webhook::from(url.to_owned()).check().unwrap();
        }
        for url in
            ["", "example.org/SECRET", "ftp://example.org/SECRET", "https:///SECRET", "https://a b/SECRET"]
        {
            let hook = Webhook::from(url.to_owned());
            assert!(!hook.check().unwrap_err().contains("SECRET"), "{url}");
            assert!(!format!("{hook:?}").contains("SECRET"), "{hook:?}");
            assert!(!String::from(hook).contains("SECRET"), "{url}");
        }
    }
}
