"""An executor without Ray: tasks run here, one after the other, and those that a test names are lost."""

from lightprobe.fleet.executor import Outcome


class Stub:
    """Runs tasks in this process; `lose` says of which tasks the process would die, `stop` after how many to
    end.
    """

    def __init__(self, function=None, lose=lambda task: False, stop=None):
        self.function, self.lose, self.stop = function, lose, stop
        self.tasks = []

    def run(self, function, tasks, needs):
        for task in tasks:
            if self.stop is not None and len(self.tasks) >= self.stop:
                raise KeyboardInterrupt
            self.tasks.append(task)
            if self.lose(task):
                yield Outcome(task, None, f"Its process or machine died in {needs.retries + 1} tries.")
            else:
                yield Outcome(task, (self.function or function)(task))
