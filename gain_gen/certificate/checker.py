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
from itertools import count
from pathlib import Path
from typing import Any

from flint import arb, arb_mat, ctx, fmpq

BITS = 192
Q_READINGS, Q_MOMENT = (27, 24, 14), 14
MORE = fmpq(1, 100)  # (a + b)^2 <= (1 + MORE) a^2 + (1 + 1 / MORE) b^2
COARSE = 3 << 11  # the trigger rounds command, sent command and floor to quarters of a N m, Q14


class Form(dict[Any, Any]):
    """A linear form: coefficient by variable; those named "rounding" are at most one."""

    def __add__(self, other: "Form") -> "Form":
        return Form({k: self.get(k, 0) + other.get(k, 0) for k in {**self, **other}})

    def times(self, factor: Any) -> "Form":
        """Return the form times a number."""
        return Form({k: factor * v for k, v in self.items()})

    def rounding(self) -> Any:
        """Return the most that all roundings together can make."""
        return sum((abs(v) for k, v in self.items() if k[0] == "rounding"), fmpq(0))


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


def controller(c: Any, gain: int, y: list[Form], past: list[Form]) -> tuple[Form, list[Form]]:
    """Return the command and the controller's next states as forms, in the ECU's units."""
    symbols = count()

    def row(coefficients: list[int], shift: int, forms: list[Form]) -> Form:
        exact = combined([fmpq(number, 1 << shift) for number in coefficients], forms)
        return exact + Form({("rounding", next(symbols)): fmpq(1, 2)})

    def advance(x: list[Form], moment: Form) -> list[Form]:
        rows = zip(c["phi"], c["gamma"], c["phi_shift"], strict=True)
        return [row([*phi, gamma], shift, [*x, moment]) for phi, gamma, shift in rows]

    rate, lateral, moment = y
    of_roll = [r[0] for r in c["compensator_b"] + c["compensator_d"]]
    of_roll = {0: [1], 1: [c["output_gain"][2]], 2: of_roll}[c["law"]]
    x = variables("c", 5 if any(of_roll) else 0)
    if x:
        x = advance(x, moment)
        for m in [m for m in (0, 1) if c["measurements"] >> m & 1]:
            coefficients = [*c["output"][m], c["output_moment"][m]]
            off = y[m] + row(coefficients, c["output_shift"][m], [*x, moment]).times(-1)
            gains = zip(x, c["correction"][m], c["correction_shift"][m], strict=True)
            x = [state + row([part], shift, [off]) for state, part, shift in gains]
    roll = x[0] if x else Form()
    if c["law"] == 1:
        wanted = row(c["output_gain"], c["output_gain_shift"], [rate, lateral, roll])
        return row([gain], 28, [wanted]), x
    if c["law"] == 2:
        n, m = c["compensator_order"], c["compensator_outputs"]
        forms = [roll, rate, lateral, Form(), *variables("c", len(x) + n)[len(x) :]]
        rows = zip(c["compensator_d"], c["compensator_c"], c["compensator_output_shift"])
        wants = [row(d + k[:n], shift, forms) for d, k, shift in rows][:m]
        forms += [row([gain], 28, [wanted]) for wanted in wants]
        names = ("compensator_b", "compensator_a", "compensator_e", "compensator_shift")
        states = list(zip(*(c[name] for name in names)))[:n]
        x += [row(b + a[:n] + e[:m], shift, forms) for b, a, e, shift in states]
        return sum(forms[4 + n :], Form()), x
    ahead = x
    for command in past[: c["predict_steps"]][::-1]:
        change = row([c["actuator_rate"]], 30, [command + moment.times(-1)])
        ahead = advance(ahead, row([1], 1, [moment + moment + change]))
        moment = moment + change
    wanted = row(c["feedback"], c["feedback_shift"], ahead)
    wanted += row(c["feedforward"], c["feedforward_shift"], ahead)
    return row([gain], 28, [wanted.times(-1)]), x


def positive(matrix: Any) -> bool:
    """Return whether every symmetric matrix within the balls is positive definite."""
    a = matrix.tolist()
    for k in range(len(a)):
        if not a[k][k] > 0:
            return False
        for i in range(k + 1, len(a)):
            factor = a[i][k] / a[k][k]
            for j in range(k + 1, i + 1):
                a[i][j] -= factor * a[j][k]
    return True


def norm(p: Any, vector: Any) -> Any:
    """Return an upper bound of the root of v'Pv."""
    return arb((vector.transpose() * p * vector)[0, 0].abs_upper()).sqrt()


def part(matrix: Any, rows: int, columns: Any) -> Any:
    """Return the first rows of some columns."""
    return arb_mat([[matrix[i, j] for j in columns] for i in range(rows)])


def flow(a: Any, b: Any, seconds: Any) -> Any:
    """Return exp of [[A, B], [0, 0]] over a time: [[Phi, Gamma], [0, 1]]."""
    rows = [[*left, *right] for left, right in zip(a.tolist(), b.tolist(), strict=True)]
    return (arb_mat([*rows, [0] * len(rows[0])]) * arb(seconds)).exp()


def remainder(a: Any, b: Any, p: Any, channel: Any, claim: Any, tick: Any, ends: Any) -> Any:
    """Return the most by which F(s) leaves centre + G w, |w| <= 1, between two instants, by P."""
    n, cells, growth = a.nrows(), claim["cells"], number(claim["growth"])
    if growth < 0 or cells < 1 or not positive(p * arb(2 * growth) - a.transpose() * p - p * a):
        raise ValueError("the growth of the car's flow is not proved")
    g, onto, centre = (balls(channel[name]) for name in ("generators", "onto", "centre"))
    step = (ends[1] - ends[0]) / cells
    whole, onward = part(flow(a, b, tick), n, [n]), flow(a, b, step)
    state = part(flow(a, b, tick - ends[1]), n + 1, [n])
    off = bend = arb(0)
    for _ in range(cells + 1):
        gamma = part(state, n, [0])
        w = onto * (whole - gamma - centre)
        if not (w.transpose() * w)[0, 0] <= 1:
            raise ValueError("the curve of the delay leaves its ellipsoid")
        off = off.max(norm(p, whole - gamma - centre - g * w))
        bend = bend.max(norm(p, a * (a * gamma + b)))
        state = onward * state
    return off + bend * arb(growth * step).exp() * arb(step * step / 8)


class Sampled:
    """The sampled loop of a condition for a claim: its variables and forms.

    Variables: the states (car, past commands, controller), what is withheld of a command (e), the
    places of the delays in their ellipsoids (w), the roundings of the controller's states (n).
    """

    def __init__(self, c: Any, condition: Any, claim: Any, tick: Any) -> None:
        bounds, off = ([number(text) for text in claim[name]] for name in ("delay", "resolution"))
        if not 0 <= bounds[0] <= bounds[1] or min(off) < 0:
            raise ValueError("the delay or a resolution is out of range")
        ages = range(int(-((-bounds[1] / tick).floor())))
        self.ends = [[max(0, min(tick, s - j * tick)) for s in bounds] for j in ages]
        past = variables("u", max(len(ages), c["predict_steps"], 1))
        x, y = variables("x", len(condition["a"])), []
        for row, bits, least in zip(condition["readings"], Q_READINGS, off, strict=False):
            y.append(combined([number(text) * (1 << bits) for text in row], x))
            y[-1] += Form({("rounding", bits, len(y)): least})
        heard = [u + Form({("rounding", "u", j): off[3]}) for j, u in enumerate(past)]
        self.command, inner = controller(c, condition["gain_factor"], y, heard)
        self.roll = combined([number(text) for text in condition["roll"]], x)
        self.extra, self.inner = self.command.rounding() + off[4], inner
        self.sent = self.command + Form({("e", 0): fmpq(1)})
        self.jumps = [past[j] + (past[j - 1] if j else self.sent).times(-1) for j in ages]
        noise = variables("n", len(inner))
        self.shifted = [self.sent, *past[:-1], *(s + n for s, n in zip(inner, noise, strict=True))]
        places = sum(len(channel["generators"][0]) for channel in claim["channels"])
        groups = (x, past, variables("c", len(inner)), variables("e", 1), variables("w", places))
        self.names = [name for group in (*groups, noise) for form in group for name in form]
        self.order = len(x) + len(past) + len(inner)

    def row(self, form: Form) -> Any:
        """Return the form's coefficients on all variables."""
        return arb_mat([[arb(form.get(name, 0)) for name in self.names]])

    def unit(self, first: int, rows: int) -> Any:
        """Return the rows that select some of the variables."""
        return arb_mat([[int(first + i == j) for j in range(len(self.names))] for i in range(rows)])


def proved(c: Any, condition: Any, claim: Any, tick: Any) -> dict[str, Any]:
    """Return the bounds that a claim's inequality proves; ValueError where it does not hold."""
    ctx.prec = BITS
    loop = Sampled(c, condition, claim, tick)
    a, b, p = balls(condition["a"]), balls(condition["b"]), balls(claim["p"])
    n, order = a.nrows(), loop.order
    if p.nrows() != order or claim["p"] != [list(r) for r in zip(*claim["p"])] or not positive(p):
        raise ValueError("P is not symmetric and positive definite")
    decay, slack, weight = (number(claim[name]) for name in ("decay", "slack", "trigger_weight"))
    noise = [number(text) for text in claim["noise_weights"]]
    weights = [number(channel["weight"]) for channel in claim["channels"]]
    share, extra, spent = fmpq(0), loop.extra, weight * loop.extra**2
    if claim["trigger"]:
        share, floor = fmpq(c["trigger_epsilon_squared"], 1 << 20), fmpq(c["trigger_floor"])
        extra += COARSE
        spent = weight * ((1 + MORE) * floor**2 + (1 + 1 / MORE) * extra**2)
    spent += sum((w * s.rounding() ** 2 for w, s in zip(noise, loop.inner, strict=True)), fmpq(0))
    fine = 0 < decay < 1 and slack > 0 and share < 1 and min([weight, *weights, *noise]) > 0
    fine = fine and len(weights) == sum(least < most for least, most in loop.ends)
    if not fine or (claim["trigger"] and c["law"] == 2 and c["compensator_outputs"] > 1):
        raise ValueError("a number is out of range")

    held, sent, at = flow(a, b, tick), loop.row(loop.sent), order + 1
    plant, full = part(p, n, range(n)), part(held, n, [n])
    moved = part(held, n, range(n)) * loop.unit(0, n) + full * sent
    form = sent.transpose() * sent * arb(weight * share * (1 + MORE))
    channels, diagonal = iter(claim["channels"]), [0] * order + [weight]
    for ends, jump in zip(loop.ends, loop.jumps, strict=True):
        v = loop.row(jump)
        if ends[0] == ends[1]:
            moved += (full - part(flow(a, b, tick - ends[0]), n, [n])) * v
            continue
        channel = next(channels)
        rho, d = remainder(a, b, plant, channel, claim, tick, ends), number(channel["weight"])
        generators = balls(channel["generators"])
        moved += balls(channel["centre"]) * v + generators * loop.unit(at, generators.ncols())
        form += v.transpose() * v * (arb(d) + rho**2 * arb((1 + 1 / slack) * len(weights)))
        at, diagonal = at + generators.ncols(), diagonal + [d] * generators.ncols()
    after = arb_mat(moved.tolist() + [loop.row(f).tolist()[0] for f in loop.shifted])
    form += after.transpose() * p * after * arb(1 + slack)
    diagonal, states, size = diagonal + noise, loop.unit(0, order), range(len(loop.names))
    form -= arb_mat([[arb(diagonal[i]) * (i == j) for j in size] for i in size])
    if not positive(states.transpose() * p * states * arb(decay) - form):
        raise ValueError("the inequality does not hold")

    level, inverse = (arb(spent) / arb(1 - decay)).sqrt(), p.inv()
    rows = (states * loop.row(form).transpose() for form in (loop.roll, loop.command))
    roll, moment = (level * norm(inverse, row) for row in rows)
    return {"roll_rad": roll, "moment_nm": (moment + arb(loop.extra)) / (1 << Q_MOMENT)}


def digest(content: Any) -> str:
    """Return the SHA-256 of a certificate's contents without its own."""
    body = {key: value for key, value in content.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def check(content: Any, integers: Any = None) -> str:
    """Return why a certificate proves nothing, or "" where every claim of it is proved."""
    if content["sha256"] != digest(content):
        return "the digest does not match the contents"
    c = content["integers"]
    if integers is not None and any(integers[name] != value for name, value in c.items()):
        return "the integers are not those of the calibration"
    for condition, claim in [(of, each) for of in content["conditions"] for each in of["claims"]]:
        try:
            for name, bound in proved(c, condition, claim, fmpq(c["tick_us"], 1000000)).items():
                if not bound <= arb(number(claim[name])):
                    raise ValueError(f"{name} is not proved")
        except (ArithmeticError, LookupError, StopIteration, TypeError, ValueError) as error:
            return f"{condition['name']}, {claim['name']}: {error}"
    return ""


if __name__ == "__main__":
    texts = [Path(name).read_text(encoding="utf-8") for name in sys.argv[1:3]]
    fields = tomllib.loads(texts[1])["calibration"] if len(texts) > 1 else None
    answer = check(json.loads(texts[0]), fields)
    print(f"no: {answer}" if answer else "yes: every claim is proved")
    sys.exit(1 if answer else 0)
