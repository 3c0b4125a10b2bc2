//! The help: keys, and terms of the view.

/// Lines of the help.
pub(super) const TEXT: [&str; 21] = [
    "↑ ↓       select a service",
    "k         kill it (SIGKILL), after a y    only with",
    "f         freeze it (SIGSTOP), after a y  --allow-faults",
    "s         set a gain: type KEY=VALUE, then Enter; Esc: no",
    "?         this help; any key closes it",
    "q, Esc    leave; Ctrl-C leaves from everywhere",
    "",
    "Hz        steps in the last second; down: dead or being started",
    "step      how long its steps of the last second took",
    "wake      how long after it could have stepped it began to",
    "age       of its oldest input at its last step; none: never had one",
    "miss      steps left out since the start",
    "late      inputs that came too late since the start",
    "died      how often it died and was restarted",
    "",
    "capture → frame   from a capture to the frame that rests on it,",
    "                  in the last second",
    "distance  from the path: the true one, in a laboratory the estimated one",
    "m̂         estimate of the mass",
    "‖b̂‖       estimate of the disturbance, its size",
    "Bars are the largest of their time; empty: nothing was known.",
];
