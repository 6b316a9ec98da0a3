"""Checks a canroll certificate in exact and ball arithmetic: python checker.py FILE CALIBRATION.

It needs python-flint and the standard library alone. From the continuous car of each condition, the
integers of the calibration and the bounds of delay and rounding it builds the sampled loop and
checks each claim's matrix inequality. What a claim is about follows from its name alone, and which
claims each condition must have is stated once more. Car, delays and resolutions are the
certificate's own: they are printed, and canroll certify --check compares them. The derivation is in
docs/certificate.md, what is assumed in docs/trust.md.
"""

# ruff: noqa: ANN401, B905, RUF005 - the numbers are those of flint; it is short to be read
import hashlib
import json
import re
import sys
import tomllib
from decimal import ROUND_CEILING, Context, Decimal
from pathlib import Path
from typing import Any

from flint import arb, arb_mat, ctx, fmpq

ctx.prec = 192
FORMAT = "canroll certificate 5"
SOURCE = ["actuator", "calibration_sha256", "firmware_sha256", "law", "vehicle", "vehicle_sha256"]
MORE, REST = fmpq(101, 100), 101  # (a + b)^2 <= MORE a^2 + REST b^2
# of every value that the code stores, as it saturates; a unit; what the trigger rounds off: two
# commands, size and floor to quarters of a N m
LIMIT, NEWTON_METRE, COARSE = 1 << 30, 1 << 14, 1 << 13
MODEL, ONE, UP = "1-DOF roll model", 1 << 28, Context(prec=5, rounding=ROUND_CEILING)
NAME = re.compile(
    rf"(draw [1-9][0-9]* of the fit, )?(laden|empty|{MODEL}), ([1-9][0-9]*) km/h"
    r"(, curve of [0-9.]+ m/s²)?(, friction [0-9.]+)?"
)
INPUTS = ("roll moment (N·m)", "steering angle (rad)", "reading of it (m/s², Q24)")


class Form(dict[Any, Any]):
    """A linear form: coefficient by variable; those named "rounding" are at most one."""

    def __add__(self, other: "Form") -> "Form":
        return Form({k: self.get(k, 0) + other.get(k, 0) for k in {**self, **other}})

    def times(self, factor: Any) -> "Form":
        """Return the form times a number."""
        return Form({k: factor * v for k, v in self.items()})

    def rounding(self, limits: Any = {}) -> Any:  # noqa: B006 - never changed
        """Return the most that all roundings, and variables with limits, together can make."""
        return sum((abs(v) * limits.get(k, k[0] == "rounding") for k, v in self.items()), fmpq(0))

    def alone(self) -> "Form":
        """Return the form with all its roundings as one of its own."""
        kept = {k: v for k, v in self.items() if k[0] != "rounding"}
        return Form({**kept, ("rounding", "of a sum"): self.rounding()})


def variables(kind: str, size: int) -> list[Form]:
    """Return the forms of the variables of a kind."""
    return [Form({(kind, i): fmpq(1)}) for i in range(size)]


def combined(coefficients: Any, forms: list[Form]) -> Form:
    """Return the sum of forms times coefficients."""
    return sum((form.times(x) for x, form in zip(coefficients, forms, strict=True)), Form())


def numbers(texts: list[str]) -> list[Any]:
    """Return the rationals of a list, which no text is, of texts "p/q" or "p"."""
    return [fmpq(text) for text in [] + texts]


def balls(rows: Any) -> Any:
    """Return a matrix from rows of such texts."""
    return arb_mat([numbers(row) for row in rows])


def rows(names: Any, *forms: Form) -> Any:
    """Return the coefficients of forms on variables."""
    return arb_mat([[arb(form.get(name, 0)) for name in names] for form in forms])


def squares(on: Any, terms: Any) -> Any:
    """Return the matrix of a sum of squares of forms, each times a factor."""
    return rows(on, *(f for _, f in terms)).transpose() * rows(on, *(f.times(x) for x, f in terms))


def factor(c: Any, speed: int) -> int:
    """Return what schedule and fade multiply the command by (Q28) at a speed (m/s, Q20)."""
    at, gains = c["schedule_speed"][: c["schedule_points"]], c["schedule_gain"]
    k = max(i for i, point in enumerate(at) if point <= speed or not i)
    after = min(k + 1, len(at) - 1)

    def share(gone: int, width: int) -> int:
        return min(max(gone, 0) * ONE // max(width, 1), ONE)

    def times(a: int, b: int) -> int:
        return (a * b + ONE // 2) // ONE

    gain = gains[k] + times(gains[after] - gains[k], share(speed - at[k], at[after] - at[k]))
    fade = share(speed - c["fade_low"], c["fade_high"] - c["fade_low"])
    return max(times(min(gain, LIMIT - 1), fade), 0)


def controller(
    c: Any, gain: int, y: list[Form], past: list[Form], stored: list[Form], *, cut: list[Form]
) -> Any:
    """Return command and next states as forms, in ECU's units; add all that is stored.

    What a compensator gets back of the command is it with the ``cut`` of a limit, if any.
    """
    (rate, lateral, moment), steered = y, variables("d", 3)[2]
    if not c["timeout_ticks"][3]:  # no actuator reports: what is commanded counts as delivered
        moment = past[0]

    def row(coefficients: list[int], shift: int, forms: list[Form]) -> Form:
        exact = combined([fmpq(number, 1 << shift) for number in coefficients], forms)
        stored.append(exact + Form({("rounding", len(stored)): fmpq(1, 2)}))
        return stored[-1]

    def advance(x: list[Form], moment: Form) -> list[Form]:
        rows = zip(c["phi"], c["gamma"], c["gamma_steering"], c["phi_shift"], strict=True)
        return [row([*phi, m, s], shift, [*x, moment, steered]) for phi, m, s, shift in rows]

    on_roll = {0: [[1]], 1: [c["output_gain"][2:]], 2: c["compensator_b"] + c["compensator_d"]}
    x = advance(variables("c", 5), moment) if any(k[0] for k in on_roll[c["law"]]) else []
    for m in [m for m in (0, 1) if x and c["measurements"] >> m & 1]:
        coefficients = [*c["output"][m], c["output_moment"][m]]
        off = y[m] + row(coefficients, c["output_shift"][m], [*x, moment]).times(-1)
        gains = zip(x, c["correction"][m], c["correction_shift"][m], strict=True)
        x = [state + row([part], shift, [off]) for state, part, shift in gains]
        stored += x
    roll = x[0] if x else Form()
    if c["law"] == 1:
        return row([gain], 28, [row(c["output_gain"], c["output_gain_shift"], [*y[:2], roll])]), x
    if c["law"] == 2:
        n, m = c["compensator_order"], c["compensator_outputs"]
        forms = [roll, rate, lateral, steered, *variables("c", len(x) + n)[len(x) :]]
        rows = zip(c["compensator_d"], c["compensator_c"], c["compensator_output_shift"])
        outputs = [row([gain], 28, [row(d + k[:n], s, forms)]) for d, k, s in list(rows)[:m]]
        # what is fed back is limited: of its roundings any part is left
        forms += [f.alone() + cut[0] for f in outputs] if cut else outputs
        states = list(zip(*(c[f"compensator_{name}"] for name in ("b", "a", "e", "shift"))))[:n]
        x += [row(b + a[:n] + e[:m], shift, forms) for b, a, e, shift in states]
        return sum(outputs, Form()), x
    ahead = x
    for command in past[: c["predict_steps"]][::-1]:
        change = row([c["actuator_rate"]], 30, [command + moment.times(-1)])
        ahead, moment = advance(ahead, row([1], 1, [moment + moment + change])), moment + change
    wanted = row(c["feedback"], c["feedback_shift"], ahead)
    stored.append(wanted + row(c["feedforward"], c["feedforward_shift"], ahead))
    return row([gain], 28, [stored[-1].times(-1)]), x


def require(truth: Any, otherwise: str) -> None:
    """Refuse what is not true."""
    if not truth:
        raise ValueError(otherwise)


def positive(m: Any) -> bool:
    """Return whether x'Mx > 0 for all x and every matrix within the balls: by leading minors."""
    return all(part(m + m.transpose(), k, range(k)).det() > 0 for k in range(1, m.nrows() + 1))


def norm(p: Any, vector: Any) -> Any:
    """Return an upper bound of the root of v'Pv."""
    return arb((vector.transpose() * p * vector)[0, 0].abs_upper()).sqrt()


def part(matrix: Any, rows: int, columns: Any) -> Any:
    """Return the first rows of some columns."""
    return arb_mat([[matrix[i, j] for j in columns] for i in range(rows)])


def remainder(flow: Any, p: Any, channel: Any, tick: Any, ends: Any) -> Any:
    """Return the most by which F(s) leaves centre + G w, |w| <= 1, between two instants, by P."""
    n, a, cells = p.nrows(), part(flow, p.nrows(), range(p.nrows())), channel["cells"]
    require(0 < cells <= 1000, "a curve has 1 to 1000 cells")
    g, onto, centre = (balls(channel[name]) for name in ("generators", "onto", "centre"))
    step, full = (ends[1] - ends[0]) / cells, part((flow * tick).exp(), n, [n])
    onward, time = (flow * step).exp(), arb(step / 2, step / 2)
    state, more = part((flow * (tick - ends[1])).exp(), flow.nrows(), [n]), a * a * (a * time).exp()
    one, complement = (onto * 0 * onto.transpose()).exp(), (a * 0).exp() - g * onto
    out, bow = [arb(0)] * 2, [arb(0)] * 2
    for _ in range(cells + 1):
        at, bend = part(state, n, [0]), part(flow * (flow * state), n, [0])  # second derivative
        state = onward * state
        for i, (by, to) in enumerate(((one, onto), (p, complement))):
            out[i] = out[i].max(norm(by, to * (full - at - centre)))
            # in the cell by its series
            bent = to * bend + to * (a * bend) * time + to * (more * bend) * (time**2 / 2)
            bow[i] = bow[i].max(norm(by, bent))
    # between two points a curve is off its chord by an eighth of its second derivative
    within, off = (x + y * step * step / 8 for x, y in zip(out, bow))
    require(within <= 1, "the curve of the delay leaves its ellipsoid")
    return off


class Sampled:
    """The sampled loop of a condition for a claim: its variables and forms.

    Variables: the states (car, past commands, controller); as inputs what a trigger withholds of a
    command and its rounding (e), the roundings of the controller's states (n) and disturbances (d);
    the places of the delays in their ellipsoids (w).
    """

    def __init__(self, c: Any, condition: Any, claim: Any, tick: Any) -> None:
        self.delay, self.off = numbers(claim["delay"]), numbers(claim["resolution"])
        ages = range(int(-((-self.delay[1] / tick).floor())))
        require(len(ages) <= 100, "a delay is longer than 100 ticks")
        self.ends = [[max(0, min(tick, s - j * tick)) for s in self.delay] for j in ages]
        past, self.outer = variables("u", max(len(ages), c["predict_steps"], 1)), variables("d", 3)
        x, driven = variables("x", len(condition["flow"])), claim["disturbances"]
        y = [combined(numbers(row), x) for row in condition["readings"]]
        y = [form + Form({("rounding", "y", j): self.off[j]}) for j, form in enumerate(y)]
        heard = [u + Form({("rounding", "u", j): self.off[3]}) for j, u in enumerate(past)]
        gain = factor(c, condition["speed"])
        self.trigger, self.limited = int(claim["trigger"]), int(claim["limited"])
        self.error, self.cut = variables("e", 1 + self.trigger), variables("a", self.limited)
        command, inner = controller(c, gain, y, heard, stored := [*y], cut=self.cut)
        noise, self.within = variables("n", len(inner)), sum(self.cut, command)
        self.sent = sum(self.error, self.within + Form({("rounding", "sent"): self.off[4]}))
        self.roll, self.stored = combined(numbers(condition["roll"]), x), [*stored, self.sent]
        self.jumps = [past[j] + (past[j - 1] if j else self.sent).times(-1) for j in ages]
        self.shifted = [self.sent, *past[:-1], *(s + n for s, n in zip(inner, noise)), *self.cut]
        self.shifted += [self.within] * self.limited
        self.before = variables("b", 2 * self.limited)
        self.states = [*x, *past, *variables("c", len(inner)), *self.before]
        self.inputs = [*self.error, *noise, *(self.outer[each["input"]] for each in driven)]
        self.places = [variables(f"w{j}", len(w["onto"])) for j, w in enumerate(claim["channels"])]
        known = self.states + self.inputs + self.cut
        self.names = [name for form in sum(self.places, known) for name in form]
        # a held command was sent with its resolution: twice that, as the threshold is at most one
        off = 2 * self.off[4] + COARSE + self.limited * (self.off[4] + command.rounding())
        floor = MORE * c["trigger_floor"] ** 2 + REST * off**2
        # what the limit cuts off, now or before, is against what it leaves, more or less anything
        # within it, as all commands in force are but for their resolution, held ones too; and
        # against the change of the command in force
        share = c["moment_max"] / (c["moment_max"] + self.off[4])
        kept, held = [u.times(share) for u in past], self.within + self.error[0]
        self.opposed = [(cut, held + kept[0].times(-1)) for cut in self.cut][: self.trigger]
        kept, lefts = kept + [held] * self.trigger, [self.within, *self.before[1:]]
        for cut, left, other in zip(self.cut + self.before[:1], lefts, lefts[::-1]):
            self.opposed += [(cut, left + v.times(i)) for v in [other, *kept] for i in (1, -1)]
        self.squares = [floor] * self.trigger + [x.rounding() ** 2 for x in (self.sent, *inner)]


def proved(c: Any, condition: Any, claim: Any, tick: Any) -> dict[str, Any]:
    """Return the bounds that a claim's inequality proves; ValueError where it does not hold."""
    loop, n, p = Sampled(c, condition, claim, tick), len(condition["flow"]), balls(claim["p"])
    decay, slack, switching = numbers([claim[k] for k in ("decay", "slack", "switching")])
    weights, share = numbers(claim["weights"]), fmpq(c["trigger_epsilon_squared"], 1 << 20) * MORE
    limits = {("d", range(3).index(e["input"])): fmpq(e["most"]) for e in claim["disturbances"]}
    bounds = [*loop.squares, *(most**2 for most in limits.values())]
    spent = sum((w * square for w, square in zip(weights, bounds, strict=True)), fmpq(0))
    fine = 0 <= loop.delay[0] <= loop.delay[1] and min(*loop.off, *weights, *limits.values()) >= 0
    limit = numbers(claim["limit"] if loop.limited else [])
    fine &= slack > 0 > decay - 1 and share <= MORE and min(c["moment_max"], *limit, 0) == 0
    fine &= c["compensator_outputs"] < 2 or not loop.trigger | loop.limited

    names, flow = loop.names, balls(condition["flow"] + [["0"] * (n + 4)] * 4)
    acting = [*loop.states[:n], loop.sent, *loop.outer]
    after = [combined(row, acting) for row in (flow * tick).exp().tolist()[:n]]
    terms = [(loop.trigger * weights[0] * share, loop.sent), (int(claim["performance"]), loop.roll)]
    # what is withheld is zero, or the command is that before: any multiple of the product is zero
    q, change = loop.trigger * switching / 4, loop.sent + loop.states[n].times(-1)
    terms += [(q, change + loop.error[0]), (-q, change + loop.error[0].times(-1))]
    for factor, (cut, by) in zip(limit, loop.opposed, strict=True):
        terms += [(factor / 4, by + cut.times(-1)), (-factor / 4, by + cut)]
    channels = zip(loop.ends, loop.jumps, loop.places, claim["channels"], strict=True)
    for ends, jump, w, channel in channels:
        rho, d = remainder(flow, part(p, n, range(n)), channel, tick, ends), fmpq(channel["weight"])
        onto = [balls(channel[name]).tolist() for name in ("centre", "generators")]
        after = [f + combined(m + g, [jump, *w]) for f, m, g in zip(after, *onto, strict=True)]
        terms += [(d + rho**2 * ((1 + 1 / slack) * len(loop.ends)), jump), *((-d, f) for f in w)]
    terms += [(-w, form) for w, form in zip(weights, loop.inputs, strict=True)]
    step, states = rows(names, *after, *loop.shifted), rows(names, *loop.states)
    form = states.transpose() * p * states * decay - squares(names, terms)
    form -= step.transpose() * p * step * (1 + slack)
    require(fine and positive(p) and positive(form), "the inequality does not hold")
    level, inverse = arb(spent / (1 - decay)).sqrt(), ((p + p.transpose()) / 2).inv()

    def most(form: Form) -> Any:
        return level * norm(inverse, states * rows(names, form).transpose()) + form.rounding(limits)

    require(all(most(form) < LIMIT for form in loop.stored), "a stored value saturates")
    return {"roll_rad": most(loop.roll), "moment_nm": most(loop.sent) / NEWTON_METRE}


def theorem(c: Any, model: Any, claim: Any, _: Any) -> dict[str, Any]:
    """Check the level of a roll model behind a delay; ValueError where the inequality fails."""
    tau, p = fmpq(claim["delay"][1]), balls(claim["p"])
    r, omega, level = numbers([claim[k] for k in ("r", "omega", "gamma_squared")])
    share = int(claim["trigger"]) * fmpq(c["trigger_epsilon_squared"], 1 << 20)
    gain = fmpq(c["output_gain"][0] << 13, 1 << c["output_gain_shift"])
    roll, rate, q, e, *w = every = variables("x", 1 + len(model["flow"][0]))
    sent, z = q + e.times(-1), combined(numbers(model["performance"]), [roll, rate])
    moved = [combined(numbers(row), [roll, rate, sent, *w]) for row in model["flow"]]
    terms = [(1, z), (omega * share, sent), (-omega, e), (r * tau, moved[1].times(gain))]
    terms += [(-r / (tau or 1), rate.times(gain) + q.times(-1)), *((-level, each) for each in w)]
    names = [name for form in every for name in form]
    form = rows(names, roll, rate).transpose() * (p + p.transpose()) * rows(names, *moved)
    form += squares(names, terms)
    fine = c["law"] == 1 and not any(c["output_gain"][1:]) and min(tau, r, omega, level) >= 0
    fine &= claim["performance"] and positive(p) and positive(form * -1)
    require(fine, "the inequality does not hold")
    return {"gamma_squared": level}


def meant(content: Any, of: Any, name: str, tick: Any) -> dict[str, Any]:
    """Return what a claim is about, by its name alone."""
    (least, most, filtered), moment = numbers(content["delay"]), [{"input": 0, "most": "0"}]
    lost = int(name[0]) if name[1:] == " lost" else 0
    driven: Any = {"every tick": [], "event trigger": [], f"{lost} lost": [], "level": moment}
    driven |= {"level with event trigger": moment, "level without delay": moment}
    driven |= {"steered": of.get("driven") or None}
    driven |= {"limited": [], "limited with event trigger": []}
    # of a sampled loop a command acts until the next one
    most += lost * tick + (filtered + tick) * ("performance" in of)
    delay = [str(seconds * ("without" not in name)) for seconds in (least, most)]
    about = {"delay": delay, "resolution": content["resolution"], "disturbances": driven[name]}
    about |= {"trigger": name.endswith("trigger"), "performance": name.startswith("level")}
    return {**about, "limited": name.startswith(("limited", "steered"))}


def digest(c: Any) -> str:
    """Return the SHA-256 of a certificate's contents without its own."""
    return hashlib.sha256(json.dumps({**c, "sha256": ""}, sort_keys=True).encode()).hexdigest()


def single(pairs: Any) -> dict[str, Any]:
    """Return an object of a file, in which no key stands twice."""
    require(len(dict(pairs)) == len(pairs), "a key stands twice")
    return dict(pairs)


def read(certificate: bytes, calibration: bytes) -> tuple[Any, Any]:
    """Return a certificate's content and the integers of its calibration; ValueError of another."""
    content = json.loads(certificate, object_pairs_hook=single)
    sha256 = hashlib.sha256(calibration).hexdigest()
    require(content["source"]["calibration_sha256"] == sha256, "the calibration is another")
    document = tomllib.loads(calibration.decode())
    require("stage" not in document, "a stage of its own makes the loop another one")
    return content, document["calibration"]


def up(number: Any) -> Decimal:
    """Return a rational with five digits, rounded up."""
    return UP.divide(Decimal(int(number.p)), Decimal(int(number.q)))


def milliseconds(least: Any, most: Any) -> str:
    """Return bounds in seconds in words, rounded outward."""
    return f"{-up(-1000 * least)} to {up(1000 * most)} ms"


def subject(content: Any, c: Any) -> str:
    """Return in words what the claims are about: data that the checker takes as they are."""
    least, most, filtered = numbers(content["delay"])
    halves = ", ".join(str(number) for number in numbers(content["resolution"]))
    claims = [[claim["name"] for claim in of["claims"]] for of in content["conditions"]]
    claimed = sum("event trigger" in names for names in claims)
    on = f"on, claimed in {claimed} of {len(claims)} conditions" if c["event_trigger"] else "off"
    lines = [f"{key}: {content['source'][key]!a}" for key in SOURCE]
    lines += [f"delays from sample to force: {milliseconds(least, most)}"]
    lines += [f"and the low-pass of the roll rate: {up(1000 * filtered)} ms"]
    lines += [f"half resolutions of roll rate, a_y, delivered moment, commands: {halves}"]
    lines += [f"conditions: {len(claims)}", f"event trigger: {on}"]
    return "".join(f"{line}\n" for line in lines)


def line(of: Any, claim: Any, bounds: Any) -> str:
    """Return a proved claim in words, its bounds rounded up."""
    text = f"proved: {of['name']}: {claim['name']}: {milliseconds(*numbers(claim['delay']))}"
    if claim["name"] == "steered":
        driven = [(INPUTS[e["input"]], fmpq(e["most"])) for e in claim["disturbances"]]
        text += "".join(f", {name} up to {up(most)}" for name, most in driven)
    known = [(key, fmpq(claim[key])) for key in bounds]
    if claim["performance"] and "weights" in claim:
        known.append(("gain_squared", fmpq(claim["weights"][-1])))
    return text + "".join(f", {key} {up(most)}" for key, most in known) + "\n"


def check(content: Any, c: Any) -> Any:
    """Yield what the claims are of, then every one once it is proved of c; raise otherwise."""
    require(content["format"] == FORMAT, f"its format is not {FORMAT!r}")
    require(content["sha256"] == digest(content), "the digest does not match the contents")
    require(sorted(content["source"]) == SOURCE, "its source is incomplete")
    fine = c["actuator"] < 2 and c["observer"] == 1 and not c["identification"]
    require(fine, "its actuator, observer or identification makes the loop another one")
    conditions, tick = content["conditions"] + content["models"], fmpq(c["tick_us"], 1000000)
    stated = {of["name"]: [claim["name"] for claim in of["claims"]] for of in conditions}
    require(stated == content["proved"] and any(stated.values()), "its claims are not those stated")
    require(len(stated) == len(conditions), "two conditions have one name")
    fine = all(of["name"] == MODEL and "performance" in of for of in content["models"])
    require(fine, "a model is none of the papers'")
    for of in content["conditions"]:
        name = NAME.fullmatch(of["name"])
        fine = name and abs((int(name[3]) * 10 << 20) - of["speed"] * 36) <= 6 << 20
        require(fine and "performance" not in of, "a condition's name is not that of its speed")
    yield subject(content, c)
    for of, claim in [(each, claim) for each in conditions for claim in each["claims"]]:
        about = claim | meant(content, of, claim["name"], tick)
        require(c["event_trigger"] or not about["trigger"], "the calibration has no event trigger")
        answer = (theorem if "performance" in of else proved)(c, of, about, tick)
        require(all(v <= fmpq(claim[k]) for k, v in answer.items()), "a bound is not proved")
        yield line(of, about, answer)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        print("usage: python checker.py CERTIFICATE CALIBRATION", file=sys.stderr)
        sys.exit(2)
    sys.excepthook = lambda kind, e, _: print("not valid:", *f"{kind.__name__}: {e}".split())
    sys.stdout.writelines(check(*read(*(Path(name).read_bytes() for name in sys.argv[1:]))))
    print(
        "valid: every claim is proved of the data above; that these are the vehicle's and the "
        "bus's is not checked"
    )
