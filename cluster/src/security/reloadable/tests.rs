use std::time::SystemTime;

use super::super::testing::Authority;
use super::*;

#[test]
fn the_ends_of_certificates_are_known() {
    let loaded = LoadedSecurity::new(Authority::new().member(), 1).unwrap();
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs();
    let [own, authority] = loaded.ends;
    assert!(own.abs_diff(now + 2 * 86_400) < 60, "{own} is not two days after {now}");
    // The end that rcgen gives an authority by default: the year 4096.
    assert!(authority > now + 1000 * 365 * 86_400, "{authority}");
}

#[test]
fn new_certificates_take_the_place_of_present_ones() {
    let authority = Authority::new();
    let security = ReloadableSecurity::new(authority.member()).unwrap();
    let (before, next) = (security.current(), authority.member());
    assert_eq!(security.replace(next.clone()), Ok(true));
    let after = security.current();
    assert!(after.generation() > before.generation());
    assert_eq!(after.certificate, next.certificate);
    assert!(!Arc::ptr_eq(&before.of_listener(), &after.of_listener()));
    // The same files once more are no change.
    assert_eq!(security.replace(next), Ok(false));
    assert_eq!(security.current().generation(), after.generation());
}

#[test]
fn a_pair_that_does_not_fit_or_that_members_would_refuse_changes_nothing() {
    let authority = Authority::new();
    let first = authority.member();
    let security = ReloadableSecurity::new(first.clone()).unwrap();
    let other = authority.member();
    let bad = [
        ("key", Security { certificate: other.certificate.clone(), ..first.clone() }),
        ("certificate", Security { certificate: b"half of a certif".to_vec(), ..first.clone() }),
        ("key", Security { key: Vec::new(), ..first.clone() }),
        ("authority", Security { ca: Vec::new(), ..first.clone() }),
        ("certificate", authority.named("client.argus.internal", 3)),
        ("certificate", authority.named(CLUSTER_NAME, 0)),
        ("certificate", Security { ca: first.ca.clone(), ..Authority::new().member() }),
    ];
    for (at, (what, wrong)) in bad.into_iter().enumerate() {
        let error = security.replace(wrong).unwrap_err();
        assert!(error.to_string().contains(what), "{at}: {error}");
        assert_eq!(security.current().security, first, "{at}: {error}");
        assert!(security.is_refused.load(Ordering::Relaxed));
    }
    assert_eq!(security.refused.load(Ordering::Relaxed), 7);
    // The earlier files, restored, are no change but end the refusal.
    assert_eq!(security.replace(first), Ok(false));
    assert!(!security.is_refused.load(Ordering::Relaxed));
}
