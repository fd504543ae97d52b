"""Options that take all the words that follow them."""

import click


class TakingMany(click.Command):
    """A command whose options with a metavar like RUN... take all the words up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """`--before a b` and `--before=a b` as `--before a --before b`."""
        many = {
            name
            for p in self.params
            if isinstance(p, click.Option) and p.multiple and (p.metavar or "").endswith("...")
            for name in p.opts
        }
        out: list[str] = []
        current, named = "", 0  # the option whose words are being read, and how many of them there are
        for word in [*args, "--"]:
            option, _, first = word.partition("=")
            if not word.startswith("-") or word == "-":
                out += [current, word] if current else [word]
                named += 1
                continue
            if current and not named:
                raise click.UsageError(f"Option '{current}' needs at least one run.", ctx)
            current, named = (option, int(bool(first))) if option in many else ("", 0)
            if option not in many:
                out.append(word)
            elif first:
                out += [option, first]
        return super().parse_args(ctx, out[:-1])
