"""Checks a canroll certificate in exact and ball arithmetic: python checker.py FILE [CALIBRATION].

It needs python-flint and the standard library alone. From the data of the file (the continuous car
of each condition, the integers of the controller, bounds of delay and rounding) it builds the
sampled loop and checks each claim's matrix inequality. The derivation is in docs/theory.md.
"""

# ruff: noqa: ANN401, B905, PLR0917 - the numbers are those of flint; it is short to be read
import hashlib
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

from flint import arb, arb_mat, ctx, fmpq

ctx.prec = 192
Q_READINGS, NEWTON_METRE = (27, 24, 14), 1 << 14
MORE, REST = fmpq(101, 100), 101  # (a + b)^2 <= MORE a^2 + REST b^2
LIMIT = 1 << 30  # of every value that the code stores; beyond it saturates
COARSE = 1 << 13  # of the trigger, Q14: it rounds two commands, size and floor to quarters of a N m


class Form(dict[Any, Any]):
    """A linear form: coefficient by variable; those named "rounding" are at most one."""

    def __add__(self, other: "Form") -> "Form":
        return Form({k: self.get(k, 0) + other.get(k, 0) for k in {**self, **other}})

    def times(self, factor: Any) -> "Form":
        """Return the form times a number."""
        return Form({k: factor * v for k, v in self.items()})

    def rounding(self, limits: Any = {}) -> Any:  # noqa: B006 - never changed
        """Return the most that all roundings, and variables with limits, together can make."""
        limit = {k: fmpq(k[0] == "rounding") for k in self} | limits
        return sum((abs(v) * limit[k] for k, v in self.items()), fmpq(0))


def variables(kind: str, size: int) -> list[Form]:
    """Return the forms of the variables of a kind."""
    return [Form({(kind, i): fmpq(1)}) for i in range(size)]


def combined(coefficients: Any, forms: list[Form]) -> Form:
    """Return the sum of forms times coefficients."""
    return sum((form.times(x) for x, form in zip(coefficients, forms, strict=True)), Form())


def number(text: str) -> Any:
    """Return the rational of "p/q" or "p"."""
    return fmpq(*(int(part) for part in text.split("/")))


def balls(rows: Any) -> Any:
    """Return a matrix from rows of such texts."""
    return arb_mat([[arb(number(text)) for text in row] for row in rows])


def rows(names: Any, *forms: Form) -> Any:
    """Return the coefficients of forms on variables."""
    return arb_mat([[arb(form.get(name, 0)) for name in names] for form in forms])


def squares(names: Any, terms: Any) -> Any:
    """Return the matrix of a sum of squares of forms, each times a factor."""
    scaled = rows(names, *(form.times(factor) for factor, form in terms))
    return rows(names, *(form for _, form in terms)).transpose() * scaled


def controller(c: Any, gain: int, y: list[Form], past: list[Form]) -> Any:
    """Return command, next states and all that is stored on the way as forms, in ECU's units."""
    steered, stored = Form({("d", 2): fmpq(1)}), list(y)

    def row(coefficients: list[int], shift: int, forms: list[Form]) -> Form:
        exact = combined([fmpq(number, 1 << shift) for number in coefficients], forms)
        stored.append(exact + Form({("rounding", len(stored)): fmpq(1, 2)}))
        return stored[-1]

    def advance(x: list[Form], moment: Form) -> list[Form]:
        rows = zip(c["phi"], c["gamma"], c["gamma_steering"], c["phi_shift"], strict=True)
        return [row([*phi, m, s], shift, [*x, moment, steered]) for phi, m, s, shift in rows]

    rate, lateral, moment = y
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
        wanted = row(c["output_gain"], c["output_gain_shift"], [rate, lateral, roll])
        return row([gain], 28, [wanted]), x, stored
    if c["law"] == 2:
        n, m = c["compensator_order"], c["compensator_outputs"]
        forms = [roll, rate, lateral, steered, *variables("c", len(x) + n)[len(x) :]]
        rows = zip(c["compensator_d"], c["compensator_c"], c["compensator_output_shift"])
        forms += [row([gain], 28, [row(d + k[:n], s, forms)]) for d, k, s in list(rows)[:m]]
        states = list(zip(*(c[f"compensator_{name}"] for name in ("b", "a", "e", "shift"))))[:n]
        x += [row(b + a[:n] + e[:m], shift, forms) for b, a, e, shift in states]
        return sum(forms[4 + n :], Form()), x, stored
    ahead = x
    for command in past[: c["predict_steps"]][::-1]:
        change = row([c["actuator_rate"]], 30, [command + moment.times(-1)])
        ahead = advance(ahead, row([1], 1, [moment + moment + change]))
        moment = moment + change
    wanted = row(c["feedback"], c["feedback_shift"], ahead)
    stored.append(wanted + row(c["feedforward"], c["feedforward_shift"], ahead))
    return row([gain], 28, [stored[-1].times(-1)]), x, stored


def require(truth: Any, otherwise: str) -> None:
    """Refuse what is not true."""
    if not truth:
        raise ValueError(otherwise)


def positive(matrix: Any) -> bool:
    """Return whether x'Mx > 0 for all x and every matrix within the balls: by leading minors."""
    both = matrix + matrix.transpose()
    return all(part(both, k, range(k)).det() > 0 for k in range(1, both.nrows() + 1))


def norm(p: Any, vector: Any) -> Any:
    """Return an upper bound of the root of v'Pv."""
    return arb((vector.transpose() * p * vector)[0, 0].abs_upper()).sqrt()


def part(matrix: Any, rows: int, columns: Any) -> Any:
    """Return the first rows of some columns."""
    return arb_mat([[matrix[i, j] for j in columns] for i in range(rows)])


def flow(a: Any, b: Any, seconds: Any) -> Any:
    """Return exp of [[A, B], [0, 0]] over a time: [[Phi, Gamma], [0, 1]]."""
    rows = [[*left, *right] for left, right in zip(a.tolist(), b.tolist(), strict=True)]
    return (arb_mat(rows + [[0] * len(rows[0])] * b.ncols()) * arb(seconds)).exp()


def remainder(a: Any, b: Any, p: Any, channel: Any, tick: Any, ends: Any) -> Any:
    """Return the most by which F(s) leaves centre + G w, |w| <= 1, between two instants, by P."""
    n, cells = a.nrows(), abs(channel["cells"])
    g, onto, centre = (balls(channel[name]) for name in ("generators", "onto", "centre"))
    step, full = (ends[1] - ends[0]) / cells, part(flow(a, b, tick), n, [n])
    onward, time = flow(a, b, step), arb(step / 2, step / 2)
    state, more = part(flow(a, b, tick - ends[1]), n + 1, [n]), a * a * (a * time).exp()
    one, complement = (onto * 0 * onto.transpose()).exp(), (a * 0).exp() - g * onto
    out, bow = [arb(0)] * 2, [arb(0)] * 2
    for _ in range(cells + 1):
        at, state = part(state, n, [0]), onward * state
        bend = a * (a * at + b)  # second derivative, in the cell by its series
        for i, (by, to) in enumerate(((one, onto), (p, complement))):
            out[i] = out[i].max(norm(by, to * (full - at - centre)))
            bent = to * bend + to * (a * bend) * time + to * (more * bend) * (time**2 / 2)
            bow[i] = bow[i].max(norm(by, bent))
    # between two points a curve is off its chord by an eighth of its second derivative
    within, off = (x + y * arb(step * step / 8) for x, y in zip(out, bow))
    require(within <= 1, "the curve of the delay leaves its ellipsoid")
    return off


class Sampled:
    """The sampled loop of a condition for a claim: its variables and forms.

    Variables: the states (car, past commands, controller); as inputs what a trigger withholds of a
    command and its rounding (e), the roundings of the controller's states (n) and disturbances (d);
    the places of the delays in their ellipsoids (w).
    """

    def __init__(self, c: Any, condition: Any, claim: Any, tick: Any) -> None:
        self.delay, self.off = (list(map(number, claim[k])) for k in ("delay", "resolution"))
        ages = range(int(-((-self.delay[1] / tick).floor())))
        self.ends = [[max(0, min(tick, s - j * tick)) for s in self.delay] for j in ages]
        past = variables("u", max(len(ages), c["predict_steps"], 1))
        x = variables("x", len(condition["a"]))
        read = [combined(map(number, row), x) for row in condition["readings"]]
        scaled = [form.times(1 << q) for form, q in zip(read, Q_READINGS, strict=True)]
        y = [form + Form({("rounding", "y", j): self.off[j]}) for j, form in enumerate(scaled)]
        heard = [u + Form({("rounding", "u", j): self.off[3]}) for j, u in enumerate(past)]
        command, inner, stored = controller(c, condition["gain_factor"], y, heard)
        self.trigger, noise = int(bool(claim["trigger"])), variables("n", len(inner))
        self.error = variables("e", 1 + self.trigger)
        self.sent = sum(self.error, command + Form({("rounding", "sent"): self.off[4]}))
        self.roll, self.stored = combined(map(number, condition["roll"]), x), [*stored, self.sent]
        self.jumps = [past[j] + (past[j - 1] if j else self.sent).times(-1) for j in ages]
        self.shifted = [self.sent, *past[:-1], *(s + n for s, n in zip(inner, noise))]
        self.driven = [Form({("d", each["input"]): fmpq(1)}) for each in claim["disturbances"]]
        self.states = [*x, *past, *variables("c", len(inner))]
        self.inputs = [*self.error, *noise, *self.driven]
        self.places = [variables(f"w{j}", len(w["onto"])) for j, w in enumerate(claim["channels"])]
        self.names = [name for form in sum(self.places, self.states + self.inputs) for name in form]
        # a held command was sent with its resolution: twice that, as the threshold is at most one
        floor = MORE * c["trigger_floor"] ** 2 + REST * (2 * self.off[4] + COARSE) ** 2
        self.squares = [floor] * self.trigger + [x.rounding() ** 2 for x in (self.sent, *inner)]


def proved(c: Any, condition: Any, claim: Any, tick: Any) -> dict[str, Any]:
    """Return the bounds that a claim's inequality proves; ValueError where it does not hold."""
    loop = Sampled(c, condition, claim, tick)
    names, a, p = loop.names, balls(condition["a"]), balls(claim["p"])
    n, inputs = a.nrows(), balls(condition["b"])
    decay, slack, *weights = map(number, (claim["decay"], claim["slack"], *claim["weights"]))
    limits = {("d", each["input"]): number(each["most"]) for each in claim["disturbances"]}
    bounds = [*loop.squares, *(most**2 for most in limits.values())]
    spent = sum((w * square for w, square in zip(weights, bounds)), fmpq(0))
    share = loop.trigger * MORE * fmpq(c["trigger_epsilon_squared"], 1 << 20)
    fine = 0 <= loop.delay[0] <= loop.delay[1] and slack > 0 and decay < 1 and share <= MORE
    fine &= min(*loop.off, *weights, *limits.values(), 0) >= 0
    fine &= len(loop.ends) == len(loop.places) and loop.trigger * c["compensator_outputs"] < 2

    held, b, plant = flow(a, inputs, tick), part(inputs, n, [0]), part(p, n, range(n))
    full = part(held, n, [n])
    moved = part(held, n, range(n)) * rows(names, *loop.states[:n]) + full * rows(names, loop.sent)
    terms = [(weights[0] * share, loop.sent), (int(bool(claim["performance"])), loop.roll)]
    # what is withheld is zero, or the command is that before: any multiple of the product is zero
    q, change = loop.trigger * number(claim["switching"]) / 4, loop.sent + loop.states[n].times(-1)
    terms += [(q, change + loop.error[0]), (-q, change + loop.error[0].times(-1))]
    for ends, jump, w, channel in zip(loop.ends, loop.jumps, loop.places, claim["channels"]):
        rho, d = remainder(a, b, plant, channel, tick, ends), number(channel["weight"])
        centre, generators = balls(channel["centre"]), balls(channel["generators"])
        moved += centre * rows(names, jump) + generators * rows(names, *w)
        terms += [(d + rho**2 * ((1 + 1 / slack) * len(loop.ends)), jump), *((-d, f) for f in w)]
    for each, form in zip(claim["disturbances"], loop.driven):
        moved += part(held, n, [n + 1 + each["input"]]) * rows(names, form)
    after, states = moved.tolist() + rows(names, *loop.shifted).tolist(), rows(names, *loop.states)
    terms += [(-w, form) for w, form in zip(weights, loop.inputs, strict=True)]
    form = states.transpose() * p * states * decay - squares(names, terms)
    form -= arb_mat(after).transpose() * p * arb_mat(after) * (1 + slack)
    require(fine and positive(p) and positive(form), "the inequality does not hold")
    level, inverse = arb(spent / (1 - decay)).sqrt(), ((p + p.transpose()) * arb(0.5)).inv()

    def most(form: Form) -> Any:
        return level * norm(inverse, states * rows(names, form).transpose()) + form.rounding(limits)

    require(all(most(form) < LIMIT for form in loop.stored), "a stored value saturates")
    return {"roll_rad": most(loop.roll), "moment_nm": most(loop.sent) / NEWTON_METRE}


def theorem(c: Any, model: Any, claim: Any, _: Any) -> dict[str, Any]:
    """Check the level of a roll model behind a delay; ValueError where the inequality fails."""
    tau, r, omega, level = (number(claim[k]) for k in ("delay", "r", "omega", "gamma_squared"))
    share = int(bool(claim["trigger"])) * fmpq(c["trigger_epsilon_squared"], 1 << 20)
    gain, p = fmpq(c["output_gain"][0] << 13, 1 << c["output_gain_shift"]), balls(claim["p"])
    names = [("x", i) for i in range(1 + len(model["flow"][0]))]
    roll, rate, q, e, *w = variables("x", len(names))
    sent, z = q + e.times(-1), combined(map(number, model["performance"]), [roll, rate])
    moved = [combined(map(number, row), [roll, rate, sent, *w]) for row in model["flow"]]
    terms = [(1, z), (omega * share, sent), (-omega, e), (r * tau, moved[1].times(gain))]
    terms += [(-r / (tau or 1), rate.times(gain) + q.times(-1)), *((-level, each) for each in w)]
    form = rows(names, roll, rate).transpose() * (p + p.transpose()) * rows(names, *moved)
    form += squares(names, terms)
    fine = c["law"] == 1 and not any(c["output_gain"][1:]) and min(tau, r, omega, level) >= 0
    require(fine and positive(p) and positive(form * -1), "the inequality does not hold")
    return {}


def digest(content: Any) -> str:
    """Return the SHA-256 of a certificate's contents without its own."""
    body = json.dumps({**content, "sha256": ""}, sort_keys=True)
    return hashlib.sha256(body.encode()).hexdigest()


def check(content: Any, integers: Any = None) -> str:
    """Return why a certificate proves nothing, or "" where every claim of it is proved."""
    if content["sha256"] != digest(content):
        return "the digest does not match the contents"
    c = content["integers"]
    if integers is not None and any(integers[name] != value for name, value in c.items()):
        return "the integers are not those of the calibration"
    conditions, tick = content["conditions"] + content["models"], fmpq(c["tick_us"], 1000000)
    for condition, claim in [(of, each) for of in conditions for each in of["claims"]]:
        try:
            answer = (theorem if "flow" in condition else proved)(c, condition, claim, tick)
            require(all(v <= number(claim[k]) for k, v in answer.items()), "a bound is not proved")
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            return f"{condition['name']}, {claim['name']}: {error}"
    return ""


if __name__ == "__main__":
    texts = [Path(name).read_text(encoding="utf-8") for name in sys.argv[1:3]]
    fields = tomllib.loads(texts[1])["calibration"] if len(texts) > 1 else None
    refusal = check(json.loads(texts[0]), fields)
    print(f"no: {refusal}" if refusal else "yes: every claim is proved")
    sys.exit(1 if refusal else 0)
