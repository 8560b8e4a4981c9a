use super::*;

/// The kinds of all turns until nothing waits. Each turn removes one item.
fn all(mut waiting: Waiting) -> Vec<Kind> {
    let mut policy = Policy::default();
    let mut kinds = Vec::new();
    while let Some(turn) = policy.next(&waiting) {
        let count = match turn.kind {
            Kind::Order => &mut waiting.orders,
            Kind::Postponed => &mut waiting.postponed,
            Kind::Sample => &mut waiting.samples,
            Kind::Pixels => &mut waiting.pixels,
            Kind::Direct => &mut waiting.direct,
            Kind::Warped => &mut waiting.warped,
            Kind::Background => &mut waiting.background,
            Kind::Prefetch => &mut waiting.prefetch,
        };
        *count -= 1;
        kinds.push(turn.kind);
    }
    kinds
}

#[test]
fn orders_precede_all_work_and_prefetched_samples_follow_it() {
    let waiting = Waiting {
        orders: 1,
        postponed: 1,
        samples: 1,
        pixels: 1,
        direct: 1,
        warped: 1,
        background: 1,
        prefetch: 1,
        ..Waiting::default()
    };
    let order = [
        Kind::Order,
        Kind::Postponed,
        Kind::Sample,
        Kind::Pixels,
        Kind::Direct,
        Kind::Warped,
        Kind::Background,
        Kind::Prefetch,
    ];
    assert_eq!(all(waiting), order);
    assert_eq!(all(Waiting::default()), []);
}

#[test]
fn no_kind_of_view_starves_another_and_views_do_not_starve_background_work() {
    use Kind::{Background, Direct, Warped};
    let waiting = Waiting { direct: 3, warped: 2, background: 2, ..Waiting::default() };
    assert_eq!(all(waiting), [Direct, Warped, Background, Direct, Warped, Background, Direct]);
}

#[test]
fn a_view_waits_for_one_slice_of_background_work_at_most() {
    let mut policy = Policy::default();
    let background = Waiting { background: 9, prefetch: 1, ..Waiting::default() };
    assert_eq!(policy.next(&background).unwrap().kind, Kind::Background);
    assert_eq!(policy.next(&background).unwrap().kind, Kind::Background);
    for kind in [Kind::Warped, Kind::Direct, Kind::Pixels] {
        let with_view = match kind {
            Kind::Warped => Waiting { warped: 1, ..background },
            Kind::Direct => Waiting { direct: 1, ..background },
            _ => Waiting { pixels: 1, ..background },
        };
        assert_eq!(policy.next(&with_view).unwrap().kind, kind);
        assert_eq!(policy.next(&background).unwrap().kind, Kind::Background);
    }
}

#[test]
fn while_a_sampler_is_made_only_work_without_it_is_done() {
    use Kind::{Background, Order, Warped};
    let waiting = Waiting { makes_sampler: true, ..Waiting::default() };
    let some = Waiting { samples: 2, pixels: 1, direct: 1, postponed: 1, prefetch: 1, ..waiting };
    assert_eq!(all(some), []);
    assert_eq!(all(Waiting { orders: 1, warped: 1, background: 1, ..some }), [Order, Warped, Background]);
}

#[test]
fn between_two_slices_of_a_sample_each_kind_of_view_gets_one_batch() {
    let mut policy = Policy::default();
    let waiting = Waiting { direct: 9, warped: 9, background: 1, samples: 1, ..Waiting::default() };
    policy.pause();
    assert_eq!(policy.between(&waiting).unwrap(), Turn { kind: Kind::Direct, most: 4 });
    assert_eq!(policy.between(&waiting).unwrap(), Turn { kind: Kind::Warped, most: 64 });
    assert_eq!(policy.between(&waiting), None);
    policy.pause();
    assert!(policy.between(&waiting).is_some());
    policy.pause();
    assert_eq!(policy.between(&Waiting { scene_changes: true, orders: 1, ..waiting }), None);
}

#[test]
fn a_busy_worker_renders_views_for_three_times_as_long_as_its_background_slices() {
    let ms = Duration::from_millis;
    let mut policy = Policy::default();
    let busy = Waiting { direct: 9, background: 9, ..Waiting::default() };
    let mut spent = (ms(0), ms(0));
    for _ in 0..65 {
        match policy.next(&busy).unwrap().kind {
            Kind::Background => {
                policy.had_slice(ms(20));
                spent.0 += ms(20);
            }
            _ => {
                policy.had_views(ms(5));
                spent.1 += ms(5);
            }
        }
    }
    assert_eq!((spent.0 * OWED, spent.0), (spent.1, ms(100)));
    // Owed time delays nothing if no view waits.
    policy.had_slice(ms(20));
    assert_eq!(policy.next(&Waiting { direct: 0, ..busy }).unwrap().kind, Kind::Background);
    // Owed time also extends the pauses of a sample.
    policy.had_slice(ms(20));
    policy.pause();
    let mut batches = 0;
    while policy.between(&busy).is_some() {
        policy.had_views(ms(10));
        batches += 1;
    }
    assert_eq!(batches, 6);
}

#[test]
fn a_batch_is_the_longest_front_of_a_queue_that_can_share_it() {
    let queue = || VecDeque::from([1, 3, 5, 2, 7]);
    let odd = |a: &i32, b: &i32| a % 2 == b % 2;
    let mut rest = queue();
    assert_eq!(take_batch(&mut rest, 9, odd), [1, 3, 5]);
    assert_eq!(rest, [2, 7]);
    assert_eq!(take_batch(&mut queue(), 2, odd), [1, 3]);
    assert_eq!(take_batch(&mut queue(), 0, odd), [1], "an empty batch would never end");
    assert!(take_batch(&mut VecDeque::new(), 4, odd).is_empty());
}

#[test]
fn every_address_is_asked_before_a_sample_is_rendered() {
    let view = Need::View { dispensable: false };
    assert_eq!([seek(view, 0, 2), seek(view, 1, 2)], [Seek::Ask(0), Seek::Ask(1)]);
    assert_eq!(seek(view, 2, 2), Seek::Render { prefetch: false });
    assert_eq!(seek(Need::View { dispensable: true }, 2, 2), Seek::GiveUp);
    let prefetch = |feeds_others| Need::Prefetch { feeds_others };
    assert_eq!(seek(prefetch(false), 0, 0), Seek::Render { prefetch: true });
    assert_eq!(seek(prefetch(false), 1, 1), Seek::AskAgain);
    assert_eq!(seek(prefetch(true), 1, 1), Seek::Render { prefetch: true });
}

#[test]
fn a_request_for_a_prefetched_sample_waits_before_it_causes_rendering() {
    assert_eq!(serve(true, false, false), Serve::Render);
    assert_eq!([serve(true, true, false), serve(true, true, true)], [Serve::Await, Serve::Render]);
    for prefetch in [false, true] {
        assert_eq!(
            [serve(false, prefetch, false), serve(false, prefetch, true)],
            [Serve::Await, Serve::Refuse]
        );
    }
}

#[test]
fn a_role_changes_once_the_old_roles_work_is_done() {
    let direct = Waiting { direct: 1, ..Waiting::default() };
    let warped = Waiting { warped: 1, ..Waiting::default() };
    assert!(!may_change_role(Role::Sampler, Role::Compositor, &direct));
    assert!(may_change_role(Role::Sampler, Role::Compositor, &warped));
    assert!(!may_change_role(Role::Both, Role::Sampler, &warped));
    assert!(
        may_change_role(Role::Both, Role::Both, &direct)
            && may_change_role(Role::Sampler, Role::Both, &direct)
    );
    assert_eq!([0, 1, 2, 8].map(threads_beside), [1, 1, 1, 7]);
}
