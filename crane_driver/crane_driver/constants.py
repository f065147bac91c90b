"""Limits, periods and tolerances of the driver, its bring-up and its panel."""

# Bus: opening, reading and stamps.
POLL_PERIOD_S = 0.1  # s, longest wait for a frame before the state of the bus is looked at
TRAIN_END_S = 5e-4  # s without a frame that end a train of them
LONGEST_TRAIN_S = 2e-3  # s
FIRST_REOPEN_PAUSE_S = 0.1  # s, before the bus is reopened; doubled at every failure
LONGEST_REOPEN_PAUSE_S = 5.0  # s
READ_TOGETHER_S = 20e-6  # s, within which two clocks are read; else they are read again
CLOCK_READ_ATTEMPTS = 5
OLDEST_STAMP_S = 1.0  # s, an older stamp of a back end is of another clock

# Instants of sampling, from the frames of one device.
EARLIEST_CYCLES = 0.5  # cycles, by which a frame may seem to come before it was sent
PROMPT_WITHIN_CYCLES = 0.25  # cycles after the promptest, within which a frame is prompt as well
OVERTAKEN_AFTER_CYCLES = 3.0  # cycles, after which no frame comes any more that was sent before
EMPTY_PART_OF_ROUND = 3  # part of a round before prompt frames in which none may come
LEAST_SUPPORT_PART = 8  # part of the frames that must be prompt
LEAST_SUPPORT_FRAMES = 3  # frames
CLOCK_WINDOW_S = 10.0  # over which the clock of a device is followed
CLOCK_KNOWN_S = 1.0  # after which it is relied on
PROMPT_TIMEOUT_S = 1.0  # in which one frame comes without delay, or the clock has changed
LEAST_INTERVAL_CYCLES = 0.1  # between two instants of sampling
LARGEST_CLOCK_DRIFT = 2e-3  # by which the clock of a device may be slow
RESTART_SILENCE_CYCLES = 4.0  # cycles, in which a device may have restarted
DOUBTED_FRAMES = 20  # frames in a row without a prompt one, after which it has
TELLING_FRAMES = 30  # frames, from which on they can tell a cycle time
CLEAR_TREND_RATIO = 4.0  # times the unevenness; a delay that ends halfway makes 2.5
LARGEST_CYCLE_DEVIATION = 0.25  # of the nominal cycle, by which a device may send faster or slower
# Frames in a row, in which a clock cannot drift by as much as `EARLIEST_CYCLES`
PROMPT_AMONG_FRAMES = 200

# Frames of several devices that belong to one cycle.
# Frames of each message, after which it is known which counters belong together
LEARNING_FRAMES = 60
LONGEST_LEARNING_RATIO = 4  # times as many, after which devices sample at different instants
LEARN_AGAIN_FRAMES = 20  # frames after which it is tried again
MOST_WAITING_FRAMES = 500  # frames of a message, on average
# Cycles between prompt frames, below which they are of one instant of sampling
SAME_INSTANT_CYCLES = 0.25
# Cycles, beyond which devices with clocks of their own have drifted by a whole one
DRIFTED_APART_CYCLES = 0.6
# Frames in a row of unknown cycle, after which all is learned again
MOST_REFUSED_FRAMES = 10
LONGEST_WAIT_CYCLES = 20  # cycles for which a frame is waited for

# CANopen devices, and valve frames.
START_RETRY_S = 1.0  # s, between two attempts to start a device
REMEMBERED_FRAMES = 64  # own frames: a third of a second of them
NEUTRAL_OPENING_SHARE = 1e-6  # share of the full opening that counts as none

# Bus logs.
GAP_CYCLES = 3  # a gap is longer than so many median cycles
LISTED_IDENTIFIERS = 10  # unknown identifiers that are named

# Loop of the driver.
FRAMES_AT_ONCE = 200  # a flood must not keep the valves waiting for their frames
OLDEST_COMMAND_S = 1.0  # a greater age is that of another clock
WARNING_PERIOD_S = 1.0
# After a command valve frames follow the commands, not the cycle, unless none comes for so long.
COMMAND_GRACE_CYCLES = 1.5  # cycles
CLOSEST_FRAMES_CYCLES = 0.5  # cycles, between two valve frames that commands cause
TIMER_EARLY_CYCLES = 0.1  # cycles, by which a timer may come too early
REPORT_PERIOD_S = 1.0

# Simulated time.
REMARK_AFTER_S = 5.0  # of real time, after which the log says who is waited for
TICK_REPEAT_S = 0.1  # of real time, between two messages of /clock while time stands still
ASK_PERIOD_S = 0.2  # of real time, between two questions who is there
PACE_CYCLES = 0.9  # cycles, by which a timer may come too early
MOST_TRAIN_FRAMES = 1000  # frames without a time

# Safety functions.
# rad, m, before a limit where motion ends: what a valve does while it closes again
LIMIT_MARGIN = 0.002
FAR_TOO_FAST_SHARE = 0.2  # of the speed of Table 2, beyond what is allowed
# Least command beyond neutral that shows the speed it gives
LEAST_OPENING = 0.005
STILL_STEPS = 3.0  # of the encoder, within which a reading counts as unchanged
CAUTION_SIGMAS = 3.0  # standard deviations, by which an estimate may be wrong
LONGEST_STEP_S = 0.05  # s; after a longer pause ramp and limiters go on as if it had been this one

# Motion by hand: commands, keyboard and joystick.
COMMAND_PERIOD_S = 0.01
LONGEST_PAUSE_S = 0.08  # between two commands; the driver refuses the next unless it is neutral
JOYSTICK_SILENCE_S = 0.1  # s
CENTRE_SHARE = 0.1  # an axis within it is at rest
REFRESH_PERIOD_S = 0.1  # s, of the display
JOG_CALLBACKS = 4  # in a period at most, so that commands do not wait
DRIVER_TIMEOUT_S = 10.0  # for a driver
LAST_COMMANDS = 5  # neutral ones at the end

# Bring-up: rest, encoders, transducers, valves and gains.
# Smallest movement, in steps of the encoder or standard deviations of its noise
MOVEMENT_STEPS = 10.0
FASTEST_SINKING = 1e-3  # rad/s, m/s: a joint that leaks is slower, one that is moved is faster
BLOCK_S = 0.5  # s
FEWEST_READINGS = 10  # readings of a joint at rest
SMALLEST_MOVEMENTS = 10.0  # movements, far above noise, that determine a sign
SCALE_TOLERANCE = 0.05  # by which a second known pose may contradict the first
LARGEST_OFFSET_PA = 1.0e6  # Pa; more is a pressure, or a transducer that is broken
LARGEST_SPREAD_PA = 5.0e4  # Pa, standard deviation of readings at rest
LARGEST_DRIFT_PA = 2.0e4  # Pa between the halves of the record
LEFT_OUT_SHARE = 0.25  # of the displacement, at its beginning
LONGEST_LAG_S = 0.5  # s
WORST_RAMP_RESIDUAL = 0.1  # of the displacement: residual of a fit that means nothing
LONGEST_LAG_SHARE = 0.02  # of the time for which the valve is open: a longer lag bends u0 and K
RATE_TOLERANCE = 0.05  # of u0 and of K, between two rates of which neither bends them
CLOSED_LOOP_RATIO = 2.0
LONGEST_RESPONSE_S = 0.5  # s, lag and dead time
WORST_STEP_RESIDUAL = 0.1  # of the displacement
DEAD_BAND_SHARE = 0.5  # of the dead band, that kp times the position tolerance may reach
SHAKEN_MOVEMENTS = 10.0  # movements, by which another joint may be shaken
TRIANGLE_MOVEMENTS = 12.0  # movements, that a triangle takes at least until it turns
STILL_S = 0.3  # s without a movement: a joint that stands
MOTION_TIMEOUT_S = 10.0  # until a joint stands, or moves
# s; stamps go back by less where the driver begins to know when was sampled
CLOCK_SET_BACK_S = 0.05
SLOWEST_RATE_RATIO = 16.0  # by which a rate is divided at most
# Share of the travel that a step response may take; at most `LONGEST_STEP_RESPONSE_S`
STEP_TRAVEL_SHARE = 0.15
LONGEST_STEP_RESPONSE_S = 1.0  # s
ANSWER_POLL_S = 0.02  # s
RAMP_REPEATS = 5  # of one ramp
DRIVER_ANSWER_TIMEOUT_S = 10.0  # for the driver to answer
STATE_TIMEOUT_S = 0.1  # without a joint state while the crane moves
NEUTRAL_AT_END_S = 0.2  # of neutral commands before the driver is disabled
LONGEST_SPIN_S = 0.1  # of real time, between two looks at the time
NEUTRAL_CYCLES = 100  # cycles of neutral commands after a reset, until the driver may be enabled

# Panel.
OLDEST_READING_S = 0.5  # an older reading is not shown as current
FAULTS_KEPT = 20
EXPERIMENT_SILENCE_S = 1.0  # feedback comes ten times a second
LARGEST_MESSAGE_BYTES = 1000  # bytes from a page; they have fifty
# After a wrong token, for the page that gave it: another page is not held up
WRONG_TOKEN_WAIT_S = 1.0
PAGE_SILENCE_S = 1.5  # a page acknowledges each picture, ten a second
LOOK_PAUSE_S = 0.5  # between two looks, beyond which the panel itself was held up; ten a second
MOST_PAGES = 16  # open at once: each costs a picture ten times a second
LONGEST_REASON_CHARACTERS = 150  # characters
ANSWER_TIMEOUT_S = 5.0  # for a page without a live line; by itself it warns after one second
WORK_PERIOD_S = 0.02
PICTURE_PERIOD_S = 0.1
PAGES_REPORT_PERIOD_S = 1.0
PANEL_CALLBACKS = 8  # in a period at most, so that pages do not wait
GOODBYE_S = 1.0  # for the answers of all pages
REFUSALS_PERIOD_S = 10.0  # in the log: a page that is refused asks again every second
