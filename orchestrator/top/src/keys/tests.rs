use proptest::prelude::*;

use super::*;

fn services() -> Vec<ServiceSnapshot> {
    ["plant", "estimator", "controller"]
        .into_iter()
        .zip(100..)
        .map(|(name, pid)| ServiceSnapshot {
            name: name.to_owned(),
            pid,
            flies: true,
            ..ServiceSnapshot::default()
        })
        .collect()
}

fn type_in(controls: &mut Controls, keys: &[Key], services: &[ServiceSnapshot]) -> Vec<Action> {
    keys.iter().map(|&key| controls.press(key, services)).collect()
}

const K: Key = Key::Character('k');
const F: Key = Key::Character('f');
const Y: Key = Key::Character('y');

#[test]
fn a_service_is_selected_and_broken_after_a_yes() {
    let mut controls = Controls::new(true);
    let keys = [Key::Down, Key::Down, Key::Down, Key::Up, K, Y];
    let actions = type_in(&mut controls, &keys, &services());
    let kill = Action::Ask(Question::KillService("estimator".to_owned()));
    assert_eq!(actions.last(), Some(&kill));
    assert!(actions[..5].iter().all(|action| *action == Action::None));
    let actions = type_in(&mut controls, &[F, Y], &services());
    let freeze = Action::Ask(Question::FreezeService("estimator".to_owned()));
    assert_eq!(actions, [Action::None, freeze]);
    assert_eq!(*controls.mode(), Mode::Watch);
}

#[test]
fn who_only_looks_breaks_nothing_and_is_told_how() {
    let mut controls = Controls::new(false);
    for key in [K, F] {
        assert_eq!(controls.press(key, &services()), Action::None);
        assert!(
            controls.notice().contains("--allow-faults"),
            "{}",
            controls.notice()
        );
        assert_eq!(controls.press(Y, &services()), Action::None);
    }
}

#[test]
fn a_service_that_is_gone_cannot_be_broken() {
    let mut dead = services();
    dead[0].flies = false;
    let mut restarted = services();
    restarted[0].pid = 200;
    // Before the question ...
    let mut controls = Controls::new(true);
    assert_eq!(
        type_in(&mut controls, &[K, Y], &dead),
        [Action::None, Action::None]
    );
    assert_eq!(type_in(&mut controls, &[K, Y], &[]), [Action::None, Action::None]);
    // ... and between the question and the answer.
    for meanwhile in [dead, restarted, Vec::new()] {
        controls.press(K, &services());
        assert_eq!(controls.press(Y, &meanwhile), Action::None);
        assert!(controls.notice().contains("gone"), "{}", controls.notice());
    }
}

#[test]
fn the_view_is_left_by_three_keys_but_a_question_only_by_ctrl_c() {
    for key in [Key::Character('q'), Key::Escape, Key::Interrupt] {
        assert_eq!(Controls::new(true).press(key, &services()), Action::Leave);
        for opened in [K, Key::Character('?')] {
            let mut controls = Controls::new(true);
            controls.press(opened, &services());
            let action = controls.press(key, &services());
            assert_eq!(action == Action::Leave, key == Key::Interrupt);
            assert!(key == Key::Interrupt || *controls.mode() == Mode::Watch);
        }
    }
}

#[test]
fn keys_of_a_terminal_are_told_apart() {
    let key = |code, modifiers| Key::of(&KeyEvent::new(code, modifiers));
    let (none, control) = (KeyModifiers::NONE, KeyModifiers::CONTROL);
    assert_eq!(key(KeyCode::Char('c'), control), Key::Interrupt);
    assert_eq!(key(KeyCode::Char('y'), control), Key::Other);
    assert_eq!(key(KeyCode::Char('y'), KeyModifiers::ALT), Key::Other);
    assert_eq!(key(KeyCode::Char('?'), KeyModifiers::SHIFT), Key::Character('?'));
    assert_eq!(key(KeyCode::Char('c'), none), Key::Character('c'));
    assert_eq!(key(KeyCode::Esc, none), Key::Escape);
}

#[test]
fn a_gain_is_set_once_its_value_is_typed_and_entered() {
    let typed = |text: &str| text.chars().map(Key::Character).collect::<Vec<_>>();
    let mut controls = Controls::new(false);
    let asks = controls.press(Key::Character('s'), &services());
    assert_eq!(asks, Action::Ask(Question::Get(Vec::new())));
    // Letters that mean something elsewhere are letters here, and without a value nothing is set.
    let keys = [
        typed("qk"),
        vec![Key::Backspace, Key::Backspace],
        typed("k1"),
        vec![Key::Enter],
    ]
    .concat();
    let actions = type_in(&mut controls, &keys, &services());
    assert!(actions.iter().all(|action| *action == Action::None));
    assert_eq!(*controls.mode(), Mode::Set("controller.k1".to_owned()));
    let actions = type_in(
        &mut controls,
        &[typed("=3.5"), vec![Key::Enter]].concat(),
        &services(),
    );
    let set = Question::Set(vec!["controller.k1=3.5".to_owned()]);
    assert_eq!(actions.last(), Some(&Action::Ask(set)));
    assert_eq!(*controls.mode(), Mode::Watch);
}

#[test]
fn a_setting_is_given_up_by_escape_and_has_a_length() {
    let mut controls = Controls::new(false);
    controls.press(Key::Character('s'), &services());
    type_in(&mut controls, &[Key::Character('=')], &services());
    assert_eq!(controls.press(Key::Escape, &services()), Action::None);
    assert_eq!(
        (controls.mode(), controls.notice()),
        (&Mode::Watch, "nothing was set")
    );

    controls.press(Key::Character('s'), &services());
    type_in(&mut controls, &[Key::Character('ü'); 1000], &services());
    let Mode::Set(setting) = controls.mode() else {
        panic!("it is being typed")
    };
    assert!(setting.len() <= MAX_SETTING + 1);
    type_in(&mut controls, &[Key::Backspace; 1000], &services());
    assert_eq!(*controls.mode(), Mode::Set(String::new()));
    assert_eq!(controls.press(Key::Interrupt, &services()), Action::Leave);
}

fn any_key() -> impl Strategy<Value = Key> {
    prop::sample::select(vec![
        K,
        F,
        Y,
        Key::Up,
        Key::Down,
        Key::Character('?'),
        Key::Character('n'),
        Key::Escape,
        Key::Character('s'),
        Key::Character('='),
        Key::Enter,
        Key::Other,
    ])
}

proptest! {
    /// Whatever is typed, a service is broken only by a `y` right after a `k` or `f`, and only the selected one.
    #[test]
    fn the_confirmation_cannot_be_skipped(keys in prop::collection::vec(any_key(), 0..40), may_break: bool) {
        let mut controls = Controls::new(may_break);
        let mut before = Key::Other;
        for key in keys {
            let selected = services()[controls.selected()].name.clone();
            let action = controls.press(key, &services());
            // A setting is no fault.
            if let Action::Ask(question) = action
                && !matches!(question, Question::Get(_) | Question::Set(_))
            {
                prop_assert!(may_break && key == Y);
                let expected = match before {
                    K => Question::KillService(selected),
                    F => Question::FreezeService(selected),
                    other => panic!("{other:?} asks nothing"),
                };
                prop_assert_eq!(question, expected);
            }
            before = key;
        }
    }
}
